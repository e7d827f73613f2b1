//! Changes of the scene language at version 2: camelCase names became snake_case, and a few names were replaced.

use super::graph::{Object, Property, Value};

/// Returns a property's name in the current scene language: `toWorld` becomes `to_world`, `intIOR` becomes `int_ior`.
pub fn property(plugin: &str, name: &str) -> String {
    let snake = snake_case(name);
    match (plugin, snake.as_str()) {
        ("diffuse" | "roughdiffuse", "diffuse_reflectance") => "reflectance".to_owned(),
        _ => snake,
    }
}

/// Adds the properties of an object that have another default in the current scene language.
pub fn defaults(object: &mut Object) {
    const CONDUCTORS: [&str; 2] = ["conductor", "roughconductor"];
    let has = |name: &str| {
        object.properties.iter().any(|property| property.name == name)
            || object.children.iter().any(|child| child.name.as_deref() == Some(name))
    };
    if CONDUCTORS.contains(&object.plugin.as_str()) && !["material", "eta", "k"].iter().any(|name| has(name))
    {
        let (name, spot) = ("material".to_owned(), object.spot.clone());
        let value = Value::Text("Cu".to_owned());
        object.properties.push(Property { name, tag: "string".to_owned(), value, spot });
    }
}

/// Returns an element's name in the current scene language.
pub fn tag(tag: &str) -> &str {
    if tag == "lookAt" { "lookat" } else { tag }
}

/// Inserts an underscore before each run of capitals that follows a small letter, and converts the run to small
/// letters.
fn snake_case(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 4);
    let mut previous = ' ';
    let mut in_run = false;
    for c in name.chars() {
        let starts = previous.is_ascii_lowercase() && c.is_ascii_uppercase();
        in_run = c.is_ascii_uppercase() && (starts || in_run);
        if starts {
            out.push('_');
        }
        out.push(if in_run { c.to_ascii_lowercase() } else { c });
        previous = c;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camel_case_becomes_snake_case() {
        let names = [
            "toWorld",
            "intIOR",
            "sampleCount",
            "hide_emitters",
            "alphaU",
            "diffuseReflectance",
            "X",
            "fovAxis",
        ];
        let upgraded = names.map(|n| property("roughconductor", n));
        assert_eq!(
            upgraded,
            [
                "to_world",
                "int_ior",
                "sample_count",
                "hide_emitters",
                "alpha_u",
                "diffuse_reflectance",
                "X",
                "fov_axis"
            ]
        );
        assert_eq!(property("diffuse", "diffuseReflectance"), "reflectance");
        assert_eq!(tag("lookAt"), "lookat");
    }
}
