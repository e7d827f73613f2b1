//! The engines and their scripts.

use super::{Farm, Line};
use crate::error::Result;
use serde_json::json;

/// A program that runs jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// Slurm: an array of jobs, and a job that merges after them.
    Slurm,
    /// GNU parallel, on this machine or others.
    Parallel,
    /// A job template of Open Job Description.
    OpenJd,
    /// make.
    Make,
}

/// The greatest number of jobs in an array. Slurm allows indices up to 1000 unless it is configured otherwise. A job
/// runs several tasks if there are more.
const LARGEST_ARRAY: usize = 1000;
/// The number of times that a failed task is started again.
const RETRIES: u32 = 3;

impl Engine {
    /// The engines by name.
    pub const NAMES: [(&str, Engine); 4] = [
        ("slurm", Engine::Slurm),
        ("parallel", Engine::Parallel),
        ("openjd", Engine::OpenJd),
        ("make", Engine::Make),
    ];

    /// Returns the command that starts the tasks in a folder, whose name has quotes where a shell needs them.
    pub(super) fn start(self, folder: &str) -> String {
        match self {
            Engine::Slurm => format!("sh {folder}/submit.sh"),
            Engine::Parallel => format!("sh {folder}/run.sh"),
            Engine::OpenJd => format!("openjd run {folder}/template.json"),
            Engine::Make => format!("make -C {folder}"),
        }
    }

    /// Returns the names and contents of the scripts. They run in the directory in which the plan was made.
    pub(super) fn scripts(self, farm: &Farm) -> Result<Vec<(&'static str, String)>> {
        let back = farm.back()?;
        let count = farm.task_count();
        // The directory comes last, because its name can be anything.
        let values = [
            ("@TASKS@", Farm::TASKS.into()),
            ("@MERGES@", Farm::MERGES.into()),
            ("@COUNT@", count.to_string()),
            ("@ARRAY@", count.min(LARGEST_ARRAY).to_string()),
            ("@RETRIES@", RETRIES.to_string()),
            ("@BACK@", back.clone()),
        ];
        let filled = |script: &str| {
            values.iter().fold(script.to_owned(), |text, (name, value)| text.replace(name, value))
        };
        Ok(match self {
            Engine::Slurm => vec![
                ("submit.sh", filled(include_str!("scripts/submit.sh"))),
                ("tasks.sbatch", filled(include_str!("scripts/tasks.sbatch"))),
                ("merge.sbatch", filled(include_str!("scripts/merge.sbatch"))),
            ],
            Engine::Parallel => vec![("run.sh", filled(include_str!("scripts/run.sh")))],
            Engine::OpenJd => vec![("template.json", template(farm, &back))],
            Engine::Make => vec![("Makefile", makefile(farm, &back)?)],
        })
    }
}

/// Returns a job template: https://github.com/OpenJobDescription/openjd-specifications, version 2023-09.
fn template(farm: &Farm, back: &str) -> String {
    let folder = "{{Param.Folder}}";
    let action = |list: &str, line: &str| {
        let script = format!(
            "cd \"$0\"/{back} && BUFFON=\"$1\" && sed -n \"$2\" \"$3\" | while read -r line; do eval \"$line\" \
             || exit 1; done"
        );
        let list = format!("{folder}/{list}");
        json!({ "actions": { "onRun": {
            "command": "bash",
            "args": ["-o", "pipefail", "-c", script, folder, "{{Param.Buffon}}", line, list],
        } } })
    };
    let range = format!("1-{}", farm.task_count());
    let template = json!({
        "specificationVersion": "jobtemplate-2023-09",
        "name": "buffon",
        "parameterDefinitions": [
            { "name": "Buffon", "type": "STRING", "default": "buffon", "description": "The program" },
            { "name": "Folder", "type": "PATH", "objectType": "DIRECTORY", "dataFlow": "INOUT", "default": ".",
              "description": "The folder of the plan" },
        ],
        "steps": [
            {
                "name": "Render",
                "parameterSpace": {
                    "taskParameterDefinitions": [{ "name": "Task", "type": "INT", "range": range }],
                },
                "script": action(Farm::TASKS, "{{Task.Param.Task}}p"),
            },
            {
                "name": "Merge",
                "dependencies": [{ "dependsOn": "Render" }],
                "script": action(Farm::MERGES, "p"),
            },
        ],
    });
    format!("{template:#}\n")
}

/// Returns a makefile. A checkpoint exists before its task is complete, so another file says that it is.
fn makefile(farm: &Farm, back: &str) -> Result<String> {
    let (tasks, merges) = (farm.task_lines()?, farm.merge_lines()?);
    let inside = |line: &Line| {
        let path = line.done.strip_prefix(&farm.folder).unwrap_or(&line.done);
        path.to_string_lossy().into_owned()
    };
    let escaped = |text: &str| text.replace('$', "$$");
    let rule = |line: &Line, needs: &str, then: &str| {
        let target = inside(line);
        format!("{target}:{needs}\n\tcd {} && \"$(BUFFON)\" {}{then}\n", escaped(back), escaped(&line.text))
    };
    let targets = |lines: &[Line]| lines.iter().map(|line| format!(" {}", inside(line))).collect::<String>();
    let mut text = format!("BUFFON ?= buffon\n\nall:{}\n\n.PHONY: all\n\n", targets(&merges));
    let mut first = 0;
    for (image, merge) in farm.images.iter().zip(&merges) {
        let count = farm.pieces(image).len();
        let of_image = &tasks[first..first + count];
        text += &rule(merge, &targets(of_image), "");
        for task in of_image {
            text += &rule(task, "", "\n\ttouch $@");
        }
        first += count;
    }
    Ok(text)
}
