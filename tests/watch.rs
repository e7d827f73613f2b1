//! `--watch`: who may see the page, what it gets, its buttons, and clients that are slow.

use crate::support::cli::{Folder, Running, program};
use buffon::image::read;
use half::f16;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A render that ends only if it is told to.
const LONG: &str = "--spp 1000000000 --adaptive=never";

/// A running render with a page.
struct Watched {
    running: Running,
    /// The host and port of its page.
    host: String,
    token: String,
    _stderr: BufReader<Box<dyn Read>>,
}

/// An answer.
struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Watched {
    /// Starts a render of the scene and reads the address of its page.
    fn start(folder: &Folder, arguments: &str) -> Self {
        let mut command = Command::new(program());
        command.args(["render", "s.xml", "-q", "--watch", ":0"]).args(arguments.split_whitespace());
        let mut running = Running::start(command.current_dir(folder.path("")).stderr(Stdio::piped()));
        let mut stderr = BufReader::new(Box::new(running.stderr()) as Box<dyn Read>);
        let mut line = String::new();
        stderr.read_line(&mut line).expect("a line");
        let url = line.strip_prefix("buffon: watch: http://").unwrap_or_else(|| panic!("{line}")).trim_end();
        let (host, token) = url.split_once('/').expect("a path");
        let (host, token) = (host.to_owned(), token.trim_end_matches('/').to_owned());
        Watched { running, host, token, _stderr: stderr }
    }

    /// Sends a request for a path with some headers; `None` if the connection ends without an answer.
    fn send(&self, method: &str, path: &str, headers: &str) -> Option<Answer> {
        let mut stream = TcpStream::connect(&self.host).ok()?;
        write!(stream, "{method} {path} HTTP/1.1\r\n{headers}\r\n").ok()?;
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).ok()?;
        let end = bytes.windows(4).position(|part| part == b"\r\n\r\n")?;
        let head = String::from_utf8(bytes[..end].to_vec()).expect("text");
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status");
        Some(Answer { status, head, body: bytes.split_off(end + 4) })
    }

    /// Gets a file of the page.
    fn get(&self, name: &str) -> Answer {
        let answer =
            self.send("GET", &format!("/{}/{name}", self.token), &format!("Host: {}\r\n", self.host));
        answer.unwrap_or_else(|| panic!("no answer for {name}"))
    }

    /// Presses a button of the page.
    fn press(&self, name: &str) -> u16 {
        let headers = format!("Host: {0}\r\nOrigin: http://{0}\r\n", self.host);
        self.send("POST", &format!("/{}/{name}", self.token), &headers).expect("an answer").status
    }

    /// Returns a state after another one, or when something has changed.
    fn state(&self, after: &Value, picture: u32) -> Value {
        let answer = self.get(&format!("state?after={after}&have={picture}"));
        assert_eq!(answer.status, 200);
        serde_json::from_slice(&answer.body).expect("JSON")
    }

    /// Follows the states until one is as expected, and returns it.
    fn wait_for(&self, is_expected: impl Fn(&Value) -> bool) -> Value {
        let mut state = self.state(&Value::Null, 0);
        while !is_expected(&state) {
            assert!(state["exit_code"].is_null(), "{state}");
            state = self.state(&state["state"], 0);
        }
        state
    }

    /// Waits for a picture, and returns the state with it.
    fn wait_for_picture(&self) -> Value {
        self.wait_for(|state| state["picture"].is_number())
    }

    /// Follows the render as a page does, and returns the last state and the last picture.
    fn follow(&self) -> (Value, Vec<u8>) {
        let mut state = Value::Null;
        let (mut picture, mut number) = (Vec::new(), 0);
        loop {
            state = self.state(&state["state"], number);
            if state["picture"].as_u64().is_some_and(|other| other != u64::from(number)) {
                picture = self.get("picture").body;
                number = u32::from_le_bytes(picture[..4].try_into().expect("four bytes"));
            }
            if state["exit_code"].is_number() {
                return (state, picture);
            }
        }
    }
}

/// Returns the size of a picture, and its planes.
fn decoded(picture: &[u8]) -> ([usize; 2], Vec<Vec<f16>>) {
    let header: Vec<usize> = picture[..16]
        .chunks_exact(4)
        .map(|bytes| u32::from_le_bytes(bytes.try_into().expect("four bytes")) as usize)
        .collect();
    let halves: Vec<f16> =
        picture[16..].chunks_exact(2).map(|bytes| f16::from_le_bytes([bytes[0], bytes[1]])).collect();
    assert_eq!(halves.len(), header[1] * header[2] * header[3]);
    ([header[1], header[2]], halves.chunks_exact(header[1] * header[2]).map(<[f16]>::to_vec).collect())
}

/// Strangers, other names and pages of other origins are refused, and the page loads nothing from elsewhere.
#[test]
fn only_the_page_itself_may_ask() {
    let folder = Folder::new();
    let watched = Watched::start(&folder, &format!("{LONG} -o r.exr"));
    let Watched { host, token, .. } = &watched;
    let own = format!("Host: {host}\r\n");
    let port = host.rsplit_once(':').expect("a port").1;
    assert!(token.len() == 32 && token.bytes().all(|b| b.is_ascii_hexdigit()), "{token}");
    let wrong = if token.starts_with('0') { token.replace('0', "1") } else { format!("0{}", &token[1..]) };
    let path = |name: &str| format!("/{token}/{name}");
    let other = format!("{own}Origin: http://localhost:1\r\n");
    let rebound = format!("Host: evil.example:{port}\r\n");
    let rebound_with_origin = format!("{rebound}Origin: http://evil.example:{port}\r\n");
    let tunnel = "Host: localhost:1234\r\nOrigin: http://localhost:1234\r\n";
    for (method, path, headers, expected) in [
        ("GET", "/".to_owned(), own.as_str(), 403),
        ("GET", "/state".to_owned(), &own, 403),
        ("GET", format!("/{wrong}/state"), &own, 403),
        ("GET", format!("/{}/state", &token[..31]), &own, 403),
        ("POST", format!("/{wrong}/stop"), &own, 403),
        ("GET", path(""), &rebound, 403),
        ("POST", path("stop"), &rebound_with_origin, 403),
        ("POST", path("stop"), &own, 403),
        ("POST", path("enough"), &other, 403),
        ("POST", path("enough"), &format!("{own}Origin: null\r\n"), 403),
        ("GET", path("stop"), &own, 405),
        ("DELETE", path("picture"), &own, 405),
        ("GET", path("nothing"), &own, 404),
        ("GET", path("state"), tunnel, 200),
    ] {
        let answer = watched.send(method, &path, headers).expect("an answer");
        assert_eq!(answer.status, expected, "{method} {path} {headers}");
    }
    assert!(watched.send("GET", &path(""), "").is_none(), "a request without a host has no answer");
    let [page, style, script] = ["", "page.css", "page.js"].map(|name| watched.get(name));
    for answer in [&page, &style, &script] {
        assert_eq!(answer.status, 200);
        for header in ["Content-Security-Policy: default-src 'none'; ", "Referrer-Policy: no-referrer\r\n"] {
            assert!(answer.head.contains(header), "{}", answer.head);
        }
        let text = String::from_utf8_lossy(&answer.body).replace("http://www.w3.org/2000/svg", "");
        for outside in ["http:", "https:", "src=\"//", "url(", "@import"] {
            assert!(!text.contains(outside), "{outside}");
        }
    }
    assert!(String::from_utf8_lossy(&page.body).contains("<script src=\"page.js\""));
    // None of that has stopped the render.
    assert!(watched.wait_for_picture()["exit_code"].is_null());
    assert_eq!(watched.press("enough"), 200);
    assert_eq!(watched.running.wait().code(), Some(0));
}

/// "That is enough" ends the render with whole parts of passes: the pixels are those of a render with that many
/// samples. The last picture is that of the file.
#[test]
fn enough_is_a_render_with_as_many_samples() {
    let folder = Folder::new();
    for options in ["", "--integrator bdpt", "--integrator sppm", "--checkpoint r.sums"] {
        let options = format!("--size 80x60 {options}");
        let watched = Watched::start(&folder, &format!("{LONG} {options} -o r.pfm --stats stats.json"));
        let state = watched.wait_for_picture();
        assert_eq!((&state["phase"], &state["name"]), (&"rendering".into(), &"r.pfm".into()));
        assert_eq!(state["progress"]["rules"]["samples"], 1_000_000_000, "{state}");
        assert_eq!(watched.press("enough"), 200);
        let (state, picture) = watched.follow();
        assert_eq!((&state["exit_code"], &state["stop_reason"]), (&0.into(), &"enough".into()), "{state}");
        assert_eq!(watched.running.wait().code(), Some(0), "{options}");
        let stats: Value = serde_json::from_slice(&folder.read("stats.json")).expect("JSON");
        assert_eq!(stats["stop_reason"], "enough");
        assert_eq!(stats["spp"], state["progress"]["samples_per_pixel"]);
        let samples = stats["spp"].as_u64().expect("a number");
        let plain = options.replace(" --checkpoint r.sums", "");
        folder.render(&format!("s.xml -q --spp {samples} --adaptive=never {plain} -o plain.pfm"));
        assert!(folder.read("r.pfm") == folder.read("plain.pfm"), "{options}: {samples} samples");

        let (size, planes) = decoded(&picture);
        let image = read(&folder.path("r.pfm")).expect("an image");
        assert_eq!((size, planes.len()), ([80, 60], 4));
        for (i, pixel) in image.data.chunks_exact(3).enumerate() {
            assert_eq!([0, 1, 2].map(|c| planes[c][i]), [0, 1, 2].map(|c| f16::from_f32(pixel[c])), "{i}");
        }
        assert!(planes[3].iter().all(|e| e.to_f32() >= 0.0) && planes[3].iter().any(|e| e.to_f32() > 0.0));
        let history = state["history"].as_array().expect("a list");
        let last = history.last().expect("a point").as_array().expect("a point");
        let numbers: Vec<f64> = last.iter().map(|v| v.as_f64().expect("a number")).collect();
        assert!(numbers[0] > 0.0 && numbers[2] <= numbers[1] && numbers[1] <= numbers[3], "{numbers:?}");
        assert_eq!(last[1], stats["relmse_estimate"]);
    }
    // The checkpoint holds what was enough, and the render can go on.
    let spp = |name: &str| -> u64 {
        let stats: Value = serde_json::from_slice(&folder.read(name)).expect("JSON");
        stats["spp"].as_u64().expect("a number")
    };
    let more = spp("stats.json") + 2;
    let options = format!("--size 80x60 --adaptive=never --spp {more} --stats more.json");
    folder.render(&format!("s.xml -q {options} --checkpoint r.sums --resume -o more.pfm"));
    assert_eq!(spp("more.json"), more);
}

/// "Stop" does what SIGINT does.
#[test]
fn stop_interrupts() {
    let folder = Folder::new();
    for (options, code) in [("", 130), ("--checkpoint r.sums", 85)] {
        let watched = Watched::start(&folder, &format!("{LONG} {options} -o r.exr --stats stats.json"));
        watched.wait_for_picture();
        // The second one is no second signal, which would end the program without an image.
        assert_eq!([watched.press("stop"), watched.press("stop")], [200; 2]);
        assert_eq!(watched.running.wait().code(), Some(code), "{options}");
        let stats: Value = serde_json::from_slice(&folder.read("stats.json")).expect("JSON");
        assert_eq!(stats["stop_reason"], "interrupted");
        assert!(read(&folder.path("r.exr")).is_ok());
        std::fs::remove_file(folder.path("r.exr")).expect("it exists");
    }
    assert!(folder.files().contains(&"r.sums".into()));
}

/// Without a page, with one that follows, and with clients that send or read nothing, the image has the same bits.
#[test]
fn no_client_changes_a_pixel_or_delays_the_end() {
    let folder = Folder::new();
    for options in ["", "--integrator ptracer", "--integrator sppm", "--sample-range 2..9"] {
        folder.render(&format!("s.xml -q --spp 12 -o a.pfm {options}"));
        folder.render(&format!("s.xml -q --spp 12 -o b.pfm --watch :0 {options}"));
        assert!(folder.read("a.pfm") == folder.read("b.pfm"), "{options}");
    }
    let options = "--size 1000x750 --spp 8 --adaptive=never";
    folder.render(&format!("s.xml -q {options} -o a.pfm"));
    let watched = Watched::start(&folder, &format!("{options} -o b.pfm"));
    let (state, picture) = watched.follow();
    assert_eq!((state["exit_code"].clone(), decoded(&picture).0), (0.into(), [1000, 750]));
    assert_eq!(watched.running.wait().code(), Some(0));
    assert!(folder.read("a.pfm") == folder.read("b.pfm"));

    let watched = Watched::start(&folder, &format!("{options} -o b.pfm"));
    watched.wait_for_picture();
    let mut asking = TcpStream::connect(&watched.host).expect("a connection");
    write!(asking, "GET /{}/picture HTTP/1.1\r\nHost: localhost\r\n\r\n", watched.token).expect("it is sent");
    let silent: Vec<_> = (0..40).map(|_| TcpStream::connect(&watched.host).expect("a connection")).collect();
    let started = Instant::now();
    assert_eq!(watched.running.wait().code(), Some(0));
    assert!(started.elapsed() < Duration::from_secs(60), "{:?}", started.elapsed());
    assert!(folder.read("a.pfm") == folder.read("b.pfm"));
    drop((asking, silent));
}

/// A page follows the frames of an animation; a failure is told.
#[test]
fn a_page_follows_frames_and_learns_of_failures() {
    let scene = crate::support::cli::SCENE
        .replace("<default name=\"spp\" value=\"8\"/>", "<default name=\"frame\" value=\"3\"/>")
        .replace("$spp", "8")
        .replace("name=\"radius\" value=\"0.5\"", "name=\"radius\" value=\"0.$frame\"");
    let folder = Folder::with(&scene);
    let watched = Watched::start(&folder, &format!("{LONG} --frames 3..5 -o r{{frame}}.pfm"));
    for frame in [3, 4] {
        let state = watched.wait_for(|state| state["frame"] == frame && state["picture"].is_number());
        assert_eq!(state["name"], format!("r{frame}.pfm"));
        assert_eq!(watched.press("enough"), 200);
    }
    let (state, _) = watched.follow();
    assert_eq!((&state["phase"], &state["frame"]), (&"finished".into(), &4.into()));
    assert_eq!(watched.running.wait().code(), Some(0));
    assert!(["r3.pfm", "r4.pfm"].iter().all(|name| folder.files().contains(&name.to_string())));

    // The folder vanishes during the render.
    std::fs::create_dir(folder.path("out")).expect("a folder");
    let watched = Watched::start(&folder, &format!("{LONG} -o out/r.pfm"));
    watched.wait_for_picture();
    std::fs::remove_dir_all(folder.path("out")).expect("it is there");
    assert_eq!(watched.press("enough"), 200);
    let (state, _) = watched.follow();
    assert_eq!((&state["phase"], &state["exit_code"]), (&"failed".into(), &4.into()));
    assert!(state["message"].as_str().is_some_and(|text| text.contains("out/r.pfm")), "{state}");
    assert_eq!(watched.running.wait().code(), Some(4));
}

#[test]
fn addresses_that_do_not_work_are_refused() {
    let folder = Folder::new();
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("an address").port();
    for (address, code, message) in [
        (
            "8000".to_owned(),
            2,
            "expected :PORT or HOST:PORT, such as :8000, or :0 for a free port".to_owned(),
        ),
        (
            "localhost:x".to_owned(),
            2,
            "expected :PORT or HOST:PORT, such as :8000, or :0 for a free port".into(),
        ),
        (
            format!(":{port}"),
            4,
            format!(
                "another program listens at port {port} of 127.0.0.1; name another port, or :0 for a free one"
            ),
        ),
        ("192.0.2.1:0".to_owned(), 4, "192.0.2.1 is no address of this machine".to_owned()),
    ] {
        let run = folder.run(&format!("render s.xml -q --spp 1 -o r.pfm --watch {address}"));
        assert_eq!((run.code, run.stderr), (code, format!("buffon: --watch {address}: {message}\n")));
    }
    assert_eq!(folder.files(), ["s.xml"]);
    let run = folder.run("plan s.xml --engine make --tasks 2 --dir farm -- --spp 4 --watch :0");
    assert!(run.code == 2 && run.stderr.contains("--watch: a plan has no such option"), "{run:?}");
}
