//! The pages of `docs/reference` against the loader: every plugin is there, with the parameters that the loader looks
//! up and with their defaults, and every example loads without a warning.

use super::{bsdfs, emitters, films, media, samplers, sensors, shapes, textures};
use crate::integrator::settings::AUTO;
use crate::integrator::{Settings, aov};
use crate::loader::mitsuba::props::RECORD;
use crate::loader::{LoadOptions, Loaded, load};
use crate::material::Material;
use crate::sampling::SamplerKind;
use crate::util::digest;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A row of a table of parameters.
struct Parameter {
    name: String,
    kind: String,
    /// Empty if there is none.
    default: String,
}

/// A part of a page: a plugin, or the parameters that several plugins have in common.
#[derive(Default)]
struct Section {
    heading: String,
    example: String,
    parameters: Vec<Parameter>,
    /// The names that are accepted and make no difference.
    ignored: BTreeSet<String>,
}

/// Returns the words of a line in backticks.
fn code(line: &str) -> Vec<String> {
    line.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn sections(page: &str) -> Vec<Section> {
    let mut sections: Vec<Section> = Vec::new();
    let (mut in_example, mut in_ignored) = (false, false);
    for line in page.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            sections.push(Section { heading: heading.to_owned(), ..Section::default() });
        }
        let Some(section) = sections.last_mut() else { continue };
        in_ignored = (in_ignored || line.starts_with("Ignored:")) && !line.is_empty();
        if line.starts_with("```") {
            in_example = line == "```xml";
        } else if in_example {
            section.example += line;
            section.example += "\n";
        } else if in_ignored {
            section.ignored.extend(code(line));
        } else if let Some(row) = line.strip_prefix("| `") {
            let cells: Vec<&str> = row.split('|').map(|cell| cell.trim()).collect();
            section.parameters.push(Parameter {
                name: cells[0].trim_end_matches('`').to_owned(),
                kind: cells[1].to_owned(),
                default: code(cells[2]).concat(),
            });
        }
    }
    sections
}

/// Returns the tag of the element with the plugin, and the place behind the plugin's name.
fn element(example: &str, plugin: &str) -> (String, usize) {
    let kind = format!(" type=\"{plugin}\"");
    let at = example.find(&kind).unwrap_or_else(|| panic!("an example of {plugin}"));
    let start = example[..at].rfind('<').expect("an element");
    (example[start + 1..at].to_owned(), at + kind.len())
}

/// Returns the example with a property in the element of the plugin.
fn with_property(example: &str, plugin: &str, property: &str) -> String {
    let (tag, from) = element(example, plugin);
    let end = from + example[from..].find('>').expect("the end of a tag");
    match example[..end].ends_with('/') {
        true => format!("{}>{property}</{tag}{}", &example[..end - 1], &example[end..]),
        false => format!("{}{property}{}", &example[..=end], &example[end + 1..]),
    }
}

/// Returns a scene around an example.
fn scene(example: &str) -> String {
    let tag: String = example.chars().skip(1).take_while(char::is_ascii_alphabetic).collect();
    let camera = r#"<sensor type="perspective"/>"#;
    let inside = |before: &str, after: &str| format!("{before}{example}{after}");
    let volpath = format!("{camera}<integrator type=\"volpath\"/>");
    let medium = |kind: &str| {
        let medium = format!("<medium type=\"{kind}\" name=\"interior\">{example}</medium>");
        format!("{volpath}<shape type=\"sphere\">{medium}</shape>")
    };
    let content = match tag.as_str() {
        "bsdf" => inside(&format!("{camera}<shape type=\"sphere\">"), "</shape>"),
        "texture" | "spectrum" => {
            let bsdf = format!("<bsdf type=\"diffuse\">{example}</bsdf>");
            format!("{camera}<shape type=\"sphere\">{bsdf}</shape>")
        }
        "medium" => inside(&format!("{volpath}<shape type=\"sphere\">"), "</shape>"),
        "phase" => medium("homogeneous"),
        "volume" => medium("heterogeneous"),
        "sensor" => example.to_owned(),
        "film" | "sampler" => inside(r#"<sensor type="perspective">"#, "</sensor>"),
        "rfilter" => inside(r#"<sensor type="perspective"><film type="hdrfilm">"#, "</film></sensor>"),
        _ if example.contains("irradiancemeter") => example.to_owned(),
        _ => inside(camera, ""),
    };
    format!("<scene version=\"3.0.0\">{content}</scene>")
}

/// Loads an example; its files are those of `scenes/plugins`.
fn loaded(example: &str) -> Loaded {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.xml");
    std::fs::write(&path, scene(example)).expect("the file is written");
    let files = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/plugins");
    let options = LoadOptions { search_paths: vec![files], ..LoadOptions::default() };
    let loaded = load(&path, &options).unwrap_or_else(|error| panic!("{error}\n{example}"));
    assert!(loaded.warnings.is_empty(), "{:?}\n{example}", loaded.warnings);
    loaded
}

/// Returns what a scene means.
fn meaning(loaded: &Loaded) -> (u64, String) {
    let Loaded { description, integrator, auto, sampler, samples_per_pixel, .. } = loaded;
    (digest(description), format!("{integrator:?} {auto:?} {sampler:?} {samples_per_pixel:?}"))
}

/// Returns the element that sets a parameter to its default.
fn property(Parameter { name, kind, default }: &Parameter) -> String {
    let tag = match kind.split(' ').next().expect("a type") {
        "float" if default.parse::<f64>().is_err() => "string",
        "color" | "volume" => "rgb",
        tag => tag,
    };
    match tag {
        "point" => {
            let [x, y, z] = [0, 1, 2].map(|i| default.split(", ").nth(i).expect("three coordinates"));
            format!("<point name=\"{name}\" x=\"{x}\" y=\"{y}\" z=\"{z}\"/>")
        }
        _ => format!("<{tag} name=\"{name}\" value=\"{default}\"/>"),
    }
}

/// Returns the parameters and the ignored names of the sections for all plugins of a kind, such as "All shapes".
fn common<'s>(sections: &'s [Section], class: &str, plugin: &str) -> impl Iterator<Item = &'s Section> {
    let (of_class, plugin) = (format!("All {class}s"), plugin.to_owned());
    sections.iter().filter(move |s| s.heading.starts_with(&of_class) && !code(&s.heading).contains(&plugin))
}

#[test]
fn the_reference_has_all_parameters_and_their_defaults() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference");
    let mut plugins: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut wrong = Vec::new();
    for page in std::fs::read_dir(folder).expect("the folder of the reference").flatten() {
        let sections = sections(&std::fs::read_to_string(page.path()).expect("UTF-8"));
        for section in sections.iter().filter(|section| section.heading.starts_with('`')) {
            let plugin = code(&section.heading).concat();
            let class = element(&section.example, &plugin).0.replace("spectrum", "texture");
            let all: Vec<&Section> = common(&sections, &class, &plugin).chain([section]).collect();
            RECORD.with_borrow_mut(BTreeSet::clear);
            let plain = meaning(&loaded(&section.example));
            for parameter in all.iter().flat_map(|section| &section.parameters) {
                let is_given = section.example.contains(&format!("name=\"{}\"", parameter.name));
                if parameter.default.is_empty() || is_given {
                    continue;
                }
                let example = with_property(&section.example, &plugin, &property(parameter));
                if meaning(&loaded(&example)) != plain {
                    wrong.push(format!("{class} {plugin}: {} is not the default", property(parameter)));
                }
            }
            let parameters = all.iter().flat_map(|s| s.parameters.iter().map(|p| p.name.clone()));
            let documented: BTreeSet<String> =
                parameters.chain(all.iter().flat_map(|s| s.ignored.clone())).collect();
            let record = RECORD.with_borrow(BTreeSet::clone);
            let looked_up = record.into_iter().filter(|[c, p, _]| *c == class && *p == plugin);
            let looked_up: BTreeSet<String> = looked_up.map(|[_, _, name]| name).collect();
            for name in documented.difference(&looked_up) {
                wrong.push(format!("{class} {plugin}: the loader does not look up {name}"));
            }
            for name in looked_up.difference(&documented) {
                wrong.push(format!("{class} {plugin}: {name} is not in the reference"));
            }
            plugins.entry(class).or_default().insert(plugin);
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let filters = bsdfs::POLARISATION_FILTERS.map(|(name, _)| name);
    let mapped = samplers::MAPPED.map(|(name, _)| name);
    let all = [
        ("bsdf", [Material::NAMES, &filters].concat()),
        ("emitter", emitters::SUPPORTED.to_vec()),
        ("film", films::SUPPORTED.to_vec()),
        ("integrator", [Settings::NAMES, &[aov::MOMENT, AUTO]].concat()),
        ("medium", media::MEDIA.to_vec()),
        ("rfilter", films::SUPPORTED_FILTERS.to_vec()),
        ("sampler", [&SamplerKind::ALL.map(SamplerKind::name)[..], &mapped].concat()),
        ("sensor", sensors::SUPPORTED.to_vec()),
        ("shape", shapes::SUPPORTED.to_vec()),
    ];
    for (class, names) in all {
        let names: BTreeSet<String> = names.into_iter().map(str::to_owned).collect();
        assert_eq!(plugins[class], names, "each {class} is in the reference");
    }
    for texture in textures::SUPPORTED {
        assert!(plugins["texture"].contains(texture), "{texture} is in the reference");
    }
}
