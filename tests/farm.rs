//! Renders split into tasks for engines. The engines here are small stand-ins that run the scripts as the real ones do.

use crate::support::cli::{Folder, SCENE, program};
use std::path::Path;
use std::process::Command;

/// An sbatch that runs the jobs at once, every index of an array, and once more if the job asks for it.
const SBATCH: &str = r#"#!/bin/bash
for script; do :; done
export SLURM_JOB_ID=17
run() {
    SLURM_RESTART_COUNT=0 bash "$script" && return
    [ -e requeued ] && rm requeued && SLURM_RESTART_COUNT=1 bash "$script"
}
array=$(sed -n 's/^#SBATCH --array=1-//p' "$script")
if [ -z "$array" ]; then
    run || exit 1
else
    for ((i = 1; i <= array; i++)); do
        export SLURM_ARRAY_TASK_ID=$i
        run || exit 1
    done
fi
echo 17
"#;
/// A scontrol that remembers that a job asked to run again. A job that sleeps after this would be killed, so `sleep`
/// ends at once.
const SCONTROL: &str = "#!/bin/sh\n[ \"$*\" = 'requeue 17' ] && touch requeued\n";
const SLEEP: &str = "#!/bin/sh\n";
/// A parallel that runs one line after the other.
const PARALLEL: &str = "#!/bin/sh\nwhile read -r line; do sh -c \"$line\" < /dev/null || exit 1; done\n";

/// Returns a shell command that can be run in the folder and finds the stand-ins and the program.
fn shell(folder: &Folder, script: &str) -> Command {
    let tools = folder.path("tools");
    std::fs::create_dir_all(&tools).expect("a folder");
    for (name, text) in [("sbatch", SBATCH), ("scontrol", SCONTROL), ("sleep", SLEEP), ("parallel", PARALLEL)]
    {
        let file = tools.join(name);
        std::fs::write(&file, text).expect("a script");
        let allowed = Command::new("chmod").arg("+x").arg(&file).status().expect("chmod starts");
        assert!(allowed.success());
    }
    let path = format!("{}:{}", tools.display(), std::env::var("PATH").expect("a path"));
    let mut command = Command::new("bash");
    command.args(["-c", script]).current_dir(folder.path(".")).env("PATH", path).env("BUFFON", program());
    command
}

/// Runs a command in the folder, which must succeed.
fn run(folder: &Folder, script: &str) {
    let output = shell(folder, script).output().expect("bash starts");
    assert!(output.status.success(), "{script}: {output:?}");
}

/// Runs the actions of a job template.
fn run_template(file: &Path) {
    let text = std::fs::read_to_string(file).expect("a template");
    let template: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
    let folder_of_plan = file.parent().expect("a folder").display().to_string();
    let steps = template["steps"].as_array().expect("steps");
    assert_eq!(steps[1]["dependencies"][0]["dependsOn"], steps[0]["name"]);
    for step in steps {
        let range = &step["parameterSpace"]["taskParameterDefinitions"][0]["range"];
        let count: u32 = range.as_str().map_or(1, |text| text[2..].parse().expect("a number"));
        let action = &step["script"]["actions"]["onRun"];
        for task in 1..=count {
            let filled = |argument: &serde_json::Value| {
                let text = argument.as_str().expect("text").replace("{{Param.Folder}}", &folder_of_plan);
                text.replace("{{Param.Buffon}}", program()).replace("{{Task.Param.Task}}", &task.to_string())
            };
            let arguments = action["args"].as_array().expect("arguments").iter().map(filled);
            let mut command = Command::new(action["command"].as_str().expect("a command"));
            let output = command.args(arguments).output().expect("it starts");
            assert!(output.status.success(), "{output:?}");
        }
    }
}

/// The channels of an image, and its values.
fn pixels(folder: &Folder, name: &str) -> (Vec<String>, Vec<f32>) {
    let image = buffon::image::read(&folder.path(name)).expect("an image");
    (image.channels, image.data)
}

/// Every engine makes the images of single renders, from frames, with options and names that a shell would change.
#[test]
fn tasks_make_the_bits_of_one_render() {
    let scene = SCENE.replace("\"radiance\" value=\"0.2\"", "\"radiance\" value=\"$frame\"");
    let folder =
        Folder::with(&scene.replace("<integrator", "<default name=\"frame\" value=\"0\"/><integrator"));
    std::fs::rename(folder.path("s.xml"), folder.path("a $shot's.xml")).expect("another name");
    let options = "--spp 7 --seed 3 --aov albedo -t 1";
    for frame in [1, 2] {
        let script = format!("\"$BUFFON\" 'a $shot'\\''s.xml' -q {options} -D frame={frame} -o {frame}.exr");
        run(&folder, &script);
    }
    for (engine, start) in [
        ("slurm", "sh farm/slurm/submit.sh --partition=some"),
        ("parallel", "sh farm/parallel/run.sh"),
        ("make", "make -C farm/make -j2"),
        ("openjd", ""),
    ] {
        let plan = format!(
            "\"$BUFFON\" plan 'a $shot'\\''s.xml' --engine {engine} --tasks 3 --dir farm/{engine} -- {options} \
             --frames 1..=2"
        );
        run(&folder, &plan);
        match engine {
            "openjd" => run_template(&folder.path("farm/openjd/template.json")),
            _ => run(&folder, start),
        }
        for frame in [1, 2] {
            let merged = format!("farm/{engine}/images/a__shot_s.{frame:04}.exr");
            assert_eq!(pixels(&folder, &merged), pixels(&folder, &format!("{frame}.exr")), "{merged}");
        }
    }
}

/// Regions and sensors have tasks and images of their own.
#[test]
fn regions_and_sensors_are_divided() {
    let sensor = SCENE.find("<sensor").expect("a sensor")..SCENE.find("</sensor>").expect("its end") + 9;
    let other =
        SCENE[sensor.clone()].replace("</sensor>", "<float name=\"shutter_close\" value=\"0\"/></sensor>");
    let other = other.replace("type=\"perspective\"", "type=\"thinlens\"").replace(
        "</sensor>",
        "<float name=\"aperture_radius\" value=\"0.1\"/><float name=\"focus_distance\" value=\"3\"/></sensor>",
    );
    let folder = Folder::with(&SCENE.replace("</scene>", &format!("{other}</scene>")));
    let options = "--spp 6 --aov albedo -q";
    for sensor in [0, 1] {
        folder.render(&format!("s.xml {options} --sensor {sensor} -o {sensor}.exr"));
    }
    assert!(pixels(&folder, "0.exr") != pixels(&folder, "1.exr"));
    let plan = "plan s.xml --engine make --tasks 5 --regions 2 --sensors all --dir farm -- --crop 0,0,40,30 --spp 6 \
                --aov albedo";
    let plan = folder.run(plan);
    assert_eq!((plan.code, plan.stdout.as_str()), (0, "farm: 2 images, 12 tasks; to start: make -C farm\n"));
    run(&folder, "make -C farm -j2");
    for sensor in [0, 1] {
        let merged = format!("farm/images/s.sensor{sensor}.exr");
        assert_eq!(pixels(&folder, &merged), pixels(&folder, &format!("{sensor}.exr")), "{merged}");
    }
}

/// GNU parallel itself, which must be installed.
#[test]
#[ignore = "needs GNU parallel: make test-all"]
fn gnu_parallel_makes_the_bits_of_one_render() {
    let folder = Folder::new();
    folder.render("s.xml -q --spp 8 -o whole.exr");
    let plan = folder.run("plan s.xml --engine parallel --tasks 3 --dir farm -- --spp 8");
    assert_eq!(plan.code, 0, "{plan:?}");
    let output = Command::new("sh")
        .args(["farm/run.sh", "--will-cite", "--jobs", "2"])
        .current_dir(folder.path("."))
        .env("BUFFON", program())
        .output()
        .expect("sh starts");
    assert!(output.status.success(), "{output:?}");
    assert_eq!(pixels(&folder, "farm/images/s.exr"), pixels(&folder, "whole.exr"));
}

/// A task goes on from its checkpoint, and refuses a scene that is not that of the plan.
#[test]
fn a_task_refuses_another_scene() {
    let folder = Folder::new();
    let run_plan = folder.run("plan s.xml --engine make --tasks 2 --dir farm");
    assert_eq!(run_plan.code, 0, "{run_plan:?}");
    assert_eq!(run_plan.stdout, "farm: 1 image, 2 tasks; to start: make -C farm\n");
    let task = std::fs::read_to_string(folder.path("farm/tasks.txt")).expect("the tasks");
    let first = task.lines().next().expect("a task");
    run(&folder, first);
    run(&folder, first);
    assert!(folder.path("farm/parts/s/00000.sums").exists() && !folder.files().contains(&"s.exr".into()));
    folder.write("s.xml", SCENE.replace("0.5,0.4,0.3", "0.5,0.4,0.2").as_bytes());
    for line in task.lines() {
        let output = shell(&folder, line).output().expect("bash starts");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(3) && text.contains("has changed"), "{output:?}");
    }
}

/// A Slurm job whose task was killed asks to run again. One whose task fails for good does not.
#[test]
fn a_slurm_job_repeats_what_was_killed_and_nothing_else() {
    let folder = Folder::new();
    let once = "#!/bin/sh\n[ -e died ] || { touch died; kill -KILL $$; }\nexec \"$REAL\" \"$@\"\n";
    folder.write("once", once.as_bytes());
    let submit = "chmod +x once; REAL=$BUFFON BUFFON=./once sh farm/submit.sh";
    let plan = folder.run("plan s.xml --engine slurm --tasks 2 --dir farm");
    assert_eq!(plan.code, 0, "{plan:?}");
    // What a task that was killed may leave.
    folder.write("farm/parts/s/00000.k1ll3d.part.sums", b"a half");
    run(&folder, submit);
    assert!(folder.path("died").exists() && folder.path("farm/images/s.exr").exists());
    folder.write("s.xml", SCENE.replace("0.5,0.4,0.3", "0.5,0.4,0.2").as_bytes());
    let output = shell(&folder, submit).output().expect("bash starts");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && text.matches("has changed").count() == 1, "{output:?}");
}

#[test]
fn mistakes_are_named() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("full")).expect("a folder");
    folder.write("full/file", b"");
    for (arguments, code, text) in [
        ("s.xml --engine pbs --dir d", 2, "expected slurm, parallel, openjd or make"),
        ("s.xml --engine make --dir full", 2, "--dir full: expected a new or empty folder"),
        ("s.xml s.xml --engine make --dir d", 2, "two images would be called s"),
        ("s.xml --engine make --dir d --tasks 0", 2, "expected a whole number of at least 1"),
        ("s.xml --engine make --dir d --sensors 1,x", 2, "expected indices such as 0,2, or all"),
        ("s.xml --engine make --dir d --sensors 0,7", 2, "--sensor 7: the scene has 1 sensor"),
        ("s.xml --engine make --dir d --sensors 0 -- -s 0", 2, "--sensor: --sensors of the plan chooses"),
        ("none.xml --engine make --dir d", 3, "none.xml"),
        ("s.xml --engine make --dir d -- --time 3s", 2, "--time: a plan has no such option for its tasks"),
        ("s.xml --engine make --dir d -- -o a.exr", 2, "-o: a plan has no such option"),
        ("s.xml --engine make --dir d -- --spq 3", 2, "unexpected argument '--spq'"),
        ("s.xml --engine make --dir d -- --frames 1..3", 3, "the scene never uses $frame"),
        ("s.xml --engine make --dir d -- --frames 1..3 -D frame=1", 2, "-D frame: --frames sets it"),
    ] {
        let run = folder.run(&format!("plan {arguments}"));
        assert!(run.code == code && run.stderr.contains(text), "{arguments}: {run:?}");
    }
    assert!(!folder.path("d/tasks.txt").exists());
    let run = folder.run("merge full -o x.exr");
    assert!(run.code == 4 && run.stderr.contains("full: expected checkpoints (*.sums)"), "{run:?}");
    let run = folder.run("render s.xml --scene-hash 1");
    assert!(
        run.code == 3 && run.stderr.contains("s.xml: --scene-hash 1: the scene or one of its"),
        "{run:?}"
    );
    let run = folder.run("render s.xml --no-image");
    assert!(run.code == 2 && run.stderr.contains("--checkpoint"), "{run:?}");
}
