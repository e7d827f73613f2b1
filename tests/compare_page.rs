//! `buffon compare`: a page with images beside each other.

use crate::support::cli::Folder;

/// The page holds all images and their errors, and asks nobody for anything.
#[test]
fn a_page_compares_images() {
    let folder = Folder::new();
    for (name, options) in
        [("a", "--spp 4 --seed 1"), ("b", "--spp 4 --seed 2"), ("small", "--spp 1 --size 8x8")]
    {
        folder.render(&format!("s.xml -q {options} -o {name}.exr --aov albedo"));
    }
    let run = folder.run("compare a.exr b.exr a.exr -o page.html");
    assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{run:?}");
    let rows: Vec<Vec<&str>> = run.stdout.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!((rows[1][0], rows[2][..2].to_vec()), ("b.exr", vec!["a.exr", "0"]), "{}", run.stdout);
    let page = String::from_utf8(folder.read("page.html")).expect("text");
    // Three images, and two maps of FLIP.
    assert_eq!(page.matches("class=\"pixels\"").count(), 3 + 2);
    assert!(rows[0].last() == Some(&"FLIP") && rows[2].last() == Some(&"0"), "{}", run.stdout);
    let run = folder.run("compare a.exr b.exr --layer albedo");
    assert_eq!(run.code, 0, "{run:?}");
    assert!(folder.files().contains(&"compare.html".to_owned()));
    for (arguments, code, text) in [
        ("a.exr", 2, "2 values required"),
        ("a.exr small.exr", 3, "small.exr: not comparable with a.exr: "),
        ("a.exr none.exr", 4, "none.exr: "),
        ("a.exr b.exr -o page.png", 2, "-o page.png: expected the extension .html"),
        ("a.exr b.exr --layer depth", 2, "--layer depth: there are "),
    ] {
        let run = folder.run(&format!("compare {arguments}"));
        assert!(run.code == code && run.stderr.contains(text), "{arguments}: {run:?}");
    }
}
