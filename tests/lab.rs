//! The laboratory through the command line.

use crate::support::cli::Folder;

/// The experiments that are fast.
#[test]
fn experiments_run_and_the_page_is_written() {
    check_page(&["one-dimension", "patterns", "light-sampling", "history", "bidirectional", "radiosity"], 32);
}

#[test]
#[ignore = "takes long: make test-all"]
fn every_experiment_runs() {
    check_page(&[], 38);
}

/// Runs experiments, or all, at their smallest: text with this number of claims, and a page with plots and images.
fn check_page(experiments: &[&str], claims: usize) {
    let folder = Folder::new();
    let run = folder.run(&format!("lab {} --quick --runs 20 -o page", experiments.join(" ")));
    assert_eq!(run.code, 0, "{run:?}");
    let page = String::from_utf8(folder.read("page/index.html")).expect("UTF-8");
    let listed = folder.run("lab --list");
    assert_eq!((listed.code, listed.stdout.lines().count()), (0, 9), "{listed:?}");
    for line in listed.stdout.lines() {
        let (name, title) = line.split_once(' ').expect("a name and a title");
        if !experiments.is_empty() && !experiments.contains(&name) {
            continue;
        }
        let title = title.trim();
        assert!(run.stdout.contains(&format!("{name}: {title}\n")), "{name}: {}", run.stdout);
        assert!(page.contains(&format!("<h2>{title}</h2>")), "{name}");
    }
    let summary = run.stdout.trim_end().lines().last().expect("a summary");
    let expected = format!("{claims} claims: ");
    assert!(summary.starts_with(&expected) && summary.ends_with(", 0 refuted"), "{}", run.stdout);
    assert!(page.matches("<svg").count() > 15 && page.matches("<img").count() > 15);
    for outside in ["http://", "https://"] {
        assert!(!page.contains(outside));
    }
    assert_eq!(folder.files(), ["page", "s.xml"]);
}

/// Runs experiments with many seeds; none may refute its claims, which are true.
fn refutes_nothing(experiments: &str, arguments: &str, seeds: std::ops::Range<u64>) {
    let folder = Folder::new();
    for seed in seeds {
        let run = folder.run(&format!("lab {experiments} -q --quick {arguments} --seed {seed}"));
        assert!(
            run.code == 0 && run.stdout.trim_end().ends_with(", 0 refuted"),
            "seed {seed}: {}",
            run.stdout
        );
    }
}

// True claims are confirmed or undecided with any seed. There are several tests, so that they run side by side.

#[test]
#[ignore = "takes long: make test-all"]
fn no_claim_on_one_dimension_is_refuted_with_any_seed() {
    refutes_nothing("one-dimension", "", 0..300);
}

#[test]
#[ignore = "takes long: make test-all"]
fn no_claim_on_one_surface_is_refuted_with_any_seed() {
    refutes_nothing("light-sampling glossy paths", "", 0..20);
    refutes_nothing("bidirectional radiosity", "", 0..4);
}

#[test]
#[ignore = "takes long: make test-all"]
fn no_claim_on_domains_patterns_and_history_is_refuted_with_any_seed() {
    refutes_nothing("domains patterns history", "", 0..20);
}

/// The seed decides everything but times: not the threads, and not the other experiments.
#[test]
#[ignore = "takes long: make test-all"]
fn a_seed_decides_the_numbers() {
    let folder = Folder::new();
    let text = |arguments: &str| {
        let run = folder.run(&format!("lab one-dimension glossy --quick --runs 10 -q {arguments}"));
        assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{run:?}");
        run.stdout
    };
    let first = text("--seed 5 -t 1");
    assert_eq!(first, text("--seed 5 -t 2"));
    assert_ne!(first, text("--seed 6"));
    let alone = folder.run("lab glossy --quick --runs 10 -q --seed 5").stdout;
    let section = alone.split("\n\n").next().expect("a section");
    assert!(first.contains(section), "{alone}");
}

#[test]
fn mistakes_are_refused_before_the_work() {
    let folder = Folder::new();
    folder.write("file", b"");
    for (arguments, code, sentence) in [
        ("lab glosy", 2, "there is no experiment \"glosy\"; there are one-dimension, domains, patterns,"),
        ("lab --runs 1", 2, "1 is not in 10..=1000000"),
        ("lab -o file", 4, "buffon: file: cannot be created: "),
    ] {
        let run = folder.run(arguments);
        assert_eq!((run.code, run.stdout.as_str()), (code, ""), "{arguments}: {run:?}");
        assert!(run.stderr.contains(sentence), "{arguments}: {run:?}");
    }
}
