//! Runs of the program in a temporary folder.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A small, fast scene with several types of shape, material and emitter, and a full-precision film of 40x30 pixels.
pub const SCENE: &str = r#"<scene version="3.0.0">
  <default name="spp" value="8"/>
  <integrator type="path"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0,1,4" target="0,0.5,0" up="0,1,0"/></transform>
    <sampler type="sobol"><integer name="sample_count" value="$spp"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="40"/><integer name="height" value="30"/>
      <string name="component_format" value="float32"/>
    </film>
  </sensor>
  <shape type="rectangle">
    <transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5,0.4,0.3"/></bsdf>
  </shape>
  <shape type="cube">
    <transform name="to_world"><scale value="0.4"/><translate x="-0.8" y="0.4"/></transform>
    <bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf>
  </shape>
  <shape type="sphere">
    <point name="center" value="0.7,0.5,0"/><float name="radius" value="0.5"/>
    <bsdf type="dielectric"/>
  </shape>
  <shape type="disk">
    <transform name="to_world"><scale value="0.3"/><translate x="0.1" y="0.3" z="0.5"/></transform>
    <bsdf type="conductor"><string name="material" value="Au"/></bsdf>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><translate y="3"/></transform>
    <emitter type="area"><rgb name="radiance" value="5"/></emitter>
  </shape>
  <emitter type="point"><point name="position" value="2,2,2"/><rgb name="intensity" value="2,3,4"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>
</scene>
"#;

/// The results of a run of the program.
#[derive(Debug)]
pub struct Run {
    /// Exit code.
    pub code: i32,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

/// A folder to run the program in, with a scene `s.xml`.
pub struct Folder(TempDir);

impl Folder {
    /// Creates a folder with [`SCENE`].
    pub fn new() -> Self {
        Folder::with(SCENE)
    }

    /// Creates a folder with a scene.
    pub fn with(scene: &str) -> Self {
        let folder = Folder(TempDir::new().expect("a folder for temporary files"));
        folder.write("s.xml", scene.as_bytes());
        folder
    }

    /// Creates a folder with one of Buffon's scenes, as `s.xml`, and the files beside it.
    pub fn of_scene(topic: &str, name: &str) -> Self {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
        let from = scenes.join(topic);
        let text = std::fs::read_to_string(from.join(name)).expect("the scene is there");
        let folder = Folder::with(&text.replace("\"../", &format!("\"{}/", scenes.display())));
        for entry in std::fs::read_dir(&from).expect("a folder").flatten().filter(|e| e.path().is_file()) {
            let name = entry.file_name();
            folder.write(&name.to_string_lossy(), &std::fs::read(entry.path()).expect("a file"));
        }
        folder
    }

    /// Returns the path of a file.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file.
    pub fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).expect("the file can be written");
    }

    /// Returns the bytes of a file.
    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Returns the names of the files in the folder, in order.
    pub fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).expect("the folder is there");
        let mut names: Vec<String> =
            entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// Runs `buffon` with the arguments (separated by spaces) in the folder.
    pub fn run(&self, arguments: &str) -> Run {
        let output = assert_cmd::Command::new(program())
            .args(arguments.split_whitespace())
            .current_dir(self.0.path())
            .output()
            .expect("the program starts");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("the program speaks UTF-8");
        Run {
            code: output.status.code().unwrap_or(-1),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }

    /// Starts `buffon render` with the scene.
    pub fn start_render(&self, arguments: &str) -> Running {
        let mut command = Command::new(program());
        command.args(["render", "s.xml", "-q"]).args(arguments.split_whitespace());
        Running::start(command.current_dir(self.0.path()).stderr(Stdio::null()))
    }

    /// Renders the scene with camera paths, light paths and both, and asserts that their images agree.
    pub fn light_paths_agree(&self, samples: u32) {
        for (i, integrator) in ["path", "ptracer", "bdpt"].into_iter().enumerate() {
            let named = connected(integrator);
            let options = format!("--spp {samples} --aov variance --seed {i} --integrator {named}");
            self.render(&format!("s.xml -q -o {integrator}.exr {options}"));
        }
        for other in ["ptracer", "bdpt"] {
            let run = self.run(&format!("diff path.exr {other}.exr --z"));
            assert_eq!(run.code, 0, "{other}: {}{}", run.stdout, run.stderr);
        }
    }

    /// Runs `buffon render` with the arguments, and asserts that it succeeds and prints nothing on standard output.
    pub fn render(&self, arguments: &str) -> Run {
        let run = self.run(&format!("render {arguments}"));
        assert_eq!((run.code, run.stdout.as_str()), (0, ""), "{arguments}: {run:?}");
        run
    }
}

/// Returns the name of an integrator for `--integrator`, with the option that lets `bdpt` connect paths without pilots.
pub fn connected(integrator: &str) -> String {
    let option = if integrator == "bdpt" { " --bdpt-connections always" } else { "" };
    format!("{integrator}{option}")
}

/// Returns the program under test.
pub fn program() -> &'static str {
    env!("CARGO_BIN_EXE_buffon")
}

/// A running program, which is killed when this is dropped.
pub struct Running(Child);

impl Running {
    /// The greatest time until a program ends.
    const TIMEOUT: Duration = Duration::from_secs(120);

    /// Starts a command. It handles signals like a program that is started by hand, also if the test runner ignores
    /// them.
    pub fn start(command: &mut Command) -> Self {
        #[cfg(unix)]
        // SAFETY: `signal` may be called between fork and exec, and nothing else is called.
        unsafe {
            use std::os::unix::process::CommandExt;
            command.pre_exec(|| {
                for signal in [libc::SIGINT, libc::SIGTERM] {
                    libc::signal(signal, libc::SIG_DFL);
                }
                Ok(())
            });
        }
        Running(command.spawn().expect("the program starts"))
    }

    /// Sends a signal to the program, which has not been waited for.
    #[cfg(unix)]
    pub fn signal(&self, signal: i32) {
        let id = i32::try_from(self.0.id()).expect("a process id");
        // SAFETY: the child has not been waited for, so the process id is still its own.
        unsafe { libc::kill(id, signal) };
    }

    /// Returns its standard output, which must be a pipe that was not taken.
    pub fn stdout(&mut self) -> BufReader<impl Read + use<>> {
        BufReader::new(self.0.stdout.take().expect("a pipe"))
    }

    /// Returns its standard error, which must be a pipe that was not taken.
    pub fn stderr(&mut self) -> BufReader<impl Read + use<>> {
        BufReader::new(self.0.stderr.take().expect("a pipe"))
    }

    /// Waits until a file is replaced or created; `false` if the program has ended before.
    #[cfg(unix)]
    pub fn wait_for_change(&mut self, path: &Path) -> bool {
        use std::os::unix::fs::MetadataExt;
        let version =
            || std::fs::metadata(path).ok().map(|file| (file.ino(), file.mtime(), file.mtime_nsec()));
        let (started, before) = (Instant::now(), version());
        while version() == before {
            if self.0.try_wait().expect("a child").is_some() {
                return false;
            }
            assert!(started.elapsed() < Self::TIMEOUT, "{} was not written", path.display());
            std::thread::sleep(Duration::from_millis(1));
        }
        true
    }

    /// Waits until the program has ended.
    ///
    /// # Panics
    /// If it takes more than two minutes.
    pub fn wait(mut self) -> ExitStatus {
        let started = Instant::now();
        while started.elapsed() < Self::TIMEOUT {
            if let Some(status) = self.0.try_wait().expect("a child") {
                return status;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        panic!("the program has not ended after {:?}", Self::TIMEOUT);
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // The program may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Waits until a file exists.
pub fn wait_for_file(path: &Path) {
    let started = Instant::now();
    while !path.exists() {
        assert!(started.elapsed() < Running::TIMEOUT, "{} was not written", path.display());
        std::thread::sleep(Duration::from_millis(5));
    }
}
