//! `--display-server`: what a viewer receives, and viewers that are missing, gone or slow.

use crate::support::cli::Folder;
use buffon::image::read;
use std::collections::HashMap;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::thread::JoinHandle;

/// A packet of tev's protocol, without its length.
struct Packet(std::vec::IntoIter<u8>);

impl Packet {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        std::array::from_fn(|_| self.0.next().expect("another byte"))
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    fn text(&mut self) -> String {
        let bytes = self.0.by_ref().take_while(|byte| *byte != 0).collect();
        String::from_utf8(bytes).expect("text")
    }

    fn texts(&mut self) -> Vec<String> {
        (0..self.u32()).map(|_| self.text()).collect()
    }
}

/// What a viewer has received.
#[derive(Default)]
struct Seen {
    name: String,
    size: [usize; 2],
    updates: usize,
    /// The last values of each channel, by rows.
    channels: HashMap<String, Vec<f32>>,
}

/// Receives packets until the connection ends.
fn receive(mut stream: TcpStream) -> Seen {
    let mut seen = Seen::default();
    let mut length = [0; 4];
    while stream.read_exact(&mut length).is_ok() {
        let mut content = vec![0; u32::from_le_bytes(length) as usize - 4];
        stream.read_exact(&mut content).expect("a whole packet");
        let mut packet = Packet(content.into_iter());
        let [kind, _grab_focus] = packet.bytes();
        let name = packet.text();
        match kind {
            4 => {
                seen.name = name;
                seen.size = [packet.u32(), packet.u32()].map(|n| n as usize);
                let area = seen.size[0] * seen.size[1];
                seen.channels = packet.texts().into_iter().map(|c| (c, vec![f32::NAN; area])).collect();
            }
            6 => {
                assert_eq!(name, seen.name);
                let names = packet.texts();
                let [x, y, width, height] = [(); 4].map(|()| packet.u32() as usize);
                let [offsets, strides] = [(); 2].map(|()| {
                    names.iter().map(|_| u64::from_le_bytes(packet.bytes()) as usize).collect::<Vec<_>>()
                });
                let data: Vec<f32> =
                    std::iter::from_fn(|| (packet.0.len() > 0).then(|| f32::from_le_bytes(packet.bytes())))
                        .collect();
                for (c, name) in names.iter().enumerate() {
                    let values = seen.channels.get_mut(name).expect("a channel of the image");
                    for i in 0..width * height {
                        let at = (y + i / width) * seen.size[0] + x + i % width;
                        values[at] = data[offsets[c] + i * strides[c]];
                    }
                }
                seen.updates += 1;
            }
            _ => panic!("a packet of kind {kind}"),
        }
    }
    seen
}

/// A listener at a free port, whose first connection `serve` handles. Returns its address, too.
fn viewer<T: Send + 'static>(serve: impl FnOnce(TcpStream) -> T + Send + 'static) -> (String, JoinHandle<T>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    (address, std::thread::spawn(move || serve(listener.accept().expect("a connection").0)))
}

/// The viewer has the pixels of the file at the end, the layers, and the standard error. The image has the same bits as
/// without a viewer.
#[test]
fn a_viewer_sees_the_image() {
    let folder = Folder::new();
    folder.render("s.xml -q --spp 16 --aov albedo -o alone.exr");
    let (address, thread) = viewer(receive);
    folder.render(&format!("s.xml -q --spp 16 --aov albedo -o shown.exr --display-server {address}"));
    let seen = thread.join().expect("the viewer");
    let [alone, shown] = ["alone.exr", "shown.exr"].map(|name| read(&folder.path(name)).expect("an image"));
    assert_eq!(alone.data, shown.data);
    assert_eq!((seen.name.as_str(), seen.size), ("shown.exr", [shown.width, shown.height]));
    for (c, name) in shown.channels.iter().enumerate() {
        for (i, value) in seen.channels[name].iter().enumerate() {
            let stored = shown.data[i * shown.channels.len() + c];
            // The file has half floats.
            assert!((value - stored).abs() <= 1e-3 * stored.abs() + 1e-6, "{name}: {value} {stored}");
        }
    }
    let errors = &seen.channels["standard_error.G"];
    assert!(errors.iter().all(|e| *e >= 0.0) && errors.iter().any(|e| *e > 0.0));
}

/// A long render shows several images.
#[test]
fn a_viewer_sees_progress() {
    let folder = Folder::new();
    let (address, thread) = viewer(receive);
    folder.render(&format!("s.xml -q --time 3s -o r.exr --display-server {address}"));
    assert!(thread.join().expect("the viewer").updates >= 2);
}

#[test]
fn viewers_that_are_missing_gone_or_slow_are_a_warning() {
    let folder = Folder::new();
    let missing = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
    let run = folder.render(&format!("s.xml --spp 1 -o r.exr --display-server {missing}"));
    assert!(run.stderr.contains(&format!("warning: --display-server {missing}: ")), "{run:?}");
    let strict = folder.run(&format!("render s.xml --spp 1 -o r.exr --strict --display-server {missing}"));
    assert!(strict.code == 5 && strict.stderr.contains("--display-server"), "{strict:?}");
    let (gone, _thread) = viewer(drop);
    // One that accepts an image and reads nothing of it.
    let (slow, _thread) = viewer(|stream| {
        std::thread::sleep(std::time::Duration::from_secs(60));
        drop(stream);
    });
    for address in [gone, slow] {
        let options = format!("--size 1200x900 --spp 2 --display-server {address}");
        let run = folder.render(&format!("s.xml -o r.exr {options}"));
        assert!(run.stderr.contains("the viewer is gone"), "{run:?}");
        assert_eq!(read(&folder.path("r.exr")).expect("an image").width, 1200);
    }
}
