//! Scene parameters: `<default>`, `$name` and `-D name=value`.

use crate::error::Error;
use crate::util::wording;

#[derive(Debug)]
struct Parameter {
    name: String,
    value: String,
    defined: bool,
    used: bool,
}

/// The parameters of a scene.
#[derive(Debug, Default)]
pub struct Parameters {
    list: Vec<Parameter>,
}

impl Parameters {
    /// Creates the parameters that the user defines. The last of several values for one name is used.
    pub fn new(defines: &[(String, String)]) -> Self {
        let mut parameters = Parameters::default();
        for (name, value) in defines {
            parameters.list.retain(|p| p.name != *name);
            parameters.add(name, value, true);
        }
        parameters
    }

    fn add(&mut self, name: &str, value: &str, defined: bool) {
        self.list.push(Parameter { name: name.into(), value: value.into(), defined, used: false });
        // The longest name is first: `$resolution` is not `$res` followed by `olution`.
        self.list.sort_by_key(|p| std::cmp::Reverse(p.name.len()));
    }

    /// Sets a `<default>`. It has no effect if the user or an earlier `<default>` has set the name.
    pub fn set_default(&mut self, name: &str, value: &str) {
        if !self.list.iter().any(|p| p.name == name) {
            self.add(name, value, false);
        }
    }

    /// Returns `text` with every `$name` replaced by the value of the longest parameter name that follows the `$`, and
    /// every `\$` replaced by `$`. Values are not searched for parameters.
    ///
    /// # Errors
    /// With a sentence, if no parameter matches.
    pub fn substitute(&mut self, text: &str) -> Result<String, String> {
        let mut out = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(at) = rest.find('$') {
            let (before, after) = (&rest[..at], &rest[at + 1..]);
            if let Some(before) = before.strip_suffix('\\') {
                out.push_str(before);
                out.push('$');
                rest = after;
                continue;
            }
            out.push_str(before);
            let Some(parameter) = self.list.iter_mut().find(|p| after.starts_with(&p.name)) else {
                let end = after.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(after.len());
                let known = wording::did_you_mean(&after[..end], self.list.iter().map(|p| p.name.as_str()));
                return Err(format!("the parameter ${} has no value{known}", &after[..end]));
            };
            parameter.used = true;
            out.push_str(&parameter.value);
            rest = &after[parameter.name.len()..];
        }
        out.push_str(rest);
        Ok(out)
    }

    /// Returns warnings about values that the user defines and the scene never uses.
    pub fn unused(&self) -> impl Iterator<Item = Error> {
        let known = || self.list.iter().filter(|p| p.used || !p.defined).map(|p| p.name.as_str());
        self.list.iter().filter(|p| p.defined && !p.used).map(move |p| {
            let near = wording::did_you_mean(&p.name, known());
            Error::scene(format!("the scene never uses ${}{near}", p.name))
                .about(format!("-D {}={}", p.name, p.value))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn defines(pairs: &[(&str, &str)]) -> Parameters {
        Parameters::new(&pairs.iter().map(|(n, v)| (n.to_string(), v.to_string())).collect::<Vec<_>>())
    }

    #[test]
    fn the_users_value_wins_over_the_default_and_the_first_default_over_later_ones() {
        let mut p = defines(&[("spp", "16"), ("spp", "32")]);
        p.set_default("spp", "64");
        p.set_default("res", "256");
        p.set_default("res", "512");
        assert_eq!(p.substitute("$spp and $res"), Ok("32 and 256".into()));
    }

    #[test]
    fn the_longest_name_wins_and_escapes_are_kept() {
        let mut p = defines(&[("a", "1"), ("ab", "2")]);
        assert_eq!(p.substitute("$ab$a $abc \\$a"), Ok("21 2c $a".into()));
        assert_eq!(p.substitute("é$aé"), Ok("é1é".into()));
    }

    #[test]
    fn unknown_and_unused_parameters_are_told() {
        let mut p = defines(&[("sppp", "16")]);
        p.set_default("spp", "64");
        p.set_default("integrator", "path");
        assert_eq!(
            p.substitute("$integator!"),
            Err("the parameter $integator has no value (did you mean \"integrator\"?)".into())
        );
        assert_eq!(p.substitute("100$"), Err("the parameter $ has no value".into()));
        let unused: Vec<_> = p.unused().map(|e| e.to_string()).collect();
        assert_eq!(unused, ["-D sppp=16: the scene never uses $sppp (did you mean \"spp\"?)"]);
    }
}
