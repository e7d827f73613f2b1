//! Lookups of an object's properties. They are recorded, so that unused properties can be reported.

use super::graph::{Child, Graph, Object, ObjectId, Property, Value};
use crate::error::{Error, Result};
use crate::math::{DAffine3, DVec3, Motion};
use crate::util::wording;
use crate::util::wording::quoted;
use std::cell::{Cell, RefCell};
use std::ops::RangeInclusive;

/// An object's properties and children, with a record of the lookups.
pub struct Props<'g> {
    /// The object.
    pub object: &'g Object,
    /// Its index.
    pub id: ObjectId,
    graph: &'g Graph,
    looked_up: RefCell<Vec<&'static str>>,
    used: Vec<Cell<bool>>,
    used_children: Vec<Cell<bool>>,
}

#[cfg(test)]
thread_local! {
    /// The class, the plugin and the name of each lookup on this thread.
    pub static RECORD: RefCell<std::collections::BTreeSet<[String; 3]>> = RefCell::default();
}

impl<'g> Props<'g> {
    /// Creates the lookup of an object's properties.
    pub fn new(graph: &'g Graph, id: ObjectId) -> Self {
        let object = &graph.objects[id];
        Props {
            object,
            id,
            graph,
            looked_up: RefCell::default(),
            used: vec![Cell::new(false); object.properties.len()],
            used_children: vec![Cell::new(false); object.children.len()],
        }
    }

    /// Returns a property by name.
    pub fn find(&self, name: &'static str) -> Option<&'g Property> {
        self.record(name);
        self.looked_up.borrow_mut().push(name);
        let i = self.object.properties.iter().position(|p| p.name == name)?;
        self.used[i].set(true);
        Some(&self.object.properties[i])
    }

    /// Returns whether there is a property or a child of the name.
    pub fn has(&self, name: &str) -> bool {
        self.record(name);
        self.object.properties.iter().any(|p| p.name == name)
            || self.object.children.iter().any(|c| c.name.as_deref() == Some(name))
    }

    /// Returns a number.
    ///
    /// # Errors
    /// If the property has another type, as for all typed lookups.
    pub fn float(&self, name: &'static str) -> Result<Option<f64>> {
        self.typed(name, "a number", |value| match value {
            Value::Float(v) => Some(*v),
            Value::Integer(v) => Some(*v as f64),
            _ => None,
        })
    }

    /// Returns a number that fits an `f32` and is greater than zero, or the default.
    ///
    /// # Errors
    /// If the property has another type or is not positive.
    pub fn positive(&self, name: &'static str, default: f32) -> Result<f32> {
        let value = self.float(name)?.unwrap_or(f64::from(default)) as f32;
        match value > 0.0 && value.is_finite() {
            true => Ok(value),
            false => Err(self.refusal(name, "expected a number greater than 0")),
        }
    }

    /// Returns a whole number in a range.
    ///
    /// # Errors
    /// If the property has another type or is out of the range.
    pub fn integer(&self, name: &'static str, range: RangeInclusive<i64>) -> Result<Option<i64>> {
        let value = self.typed(name, "a whole number", |value| match value {
            Value::Integer(v) => Some(*v),
            _ => None,
        })?;
        match value {
            Some(v) if !range.contains(&v) => Err(self.refusal(
                name,
                &format!("expected a whole number from {} to {}", range.start(), range.end()),
            )),
            value => Ok(value),
        }
    }

    /// Returns a boolean, or the default.
    ///
    /// # Errors
    /// If the property has another type.
    pub fn boolean(&self, name: &'static str, default: bool) -> Result<bool> {
        let value = self.typed(name, "true or false", |value| match value {
            Value::Boolean(v) => Some(*v),
            _ => None,
        })?;
        Ok(value.unwrap_or(default))
    }

    /// Returns a text.
    ///
    /// # Errors
    /// If the property has another type.
    pub fn text(&self, name: &'static str) -> Result<Option<&'g str>> {
        self.typed(name, "a string", |value| match value {
            Value::Text(v) => Some(v.as_str()),
            _ => None,
        })
    }

    /// Returns the value of one of several words, in any case, or the default.
    ///
    /// # Errors
    /// If the property has another type or is none of the words.
    pub fn choice<T: Copy>(&self, name: &'static str, words: &[(&str, T)], default: T) -> Result<T> {
        let Some(text) = self.text(name)? else { return Ok(default) };
        let found = words.iter().find(|(word, _)| word.eq_ignore_ascii_case(text));
        found.map(|(_, value)| *value).ok_or_else(|| {
            let list: Vec<_> = words.iter().map(|(word, _)| *word).collect();
            self.refusal(name, &format!("expected one of {}", list.join(", ")))
        })
    }

    /// Returns a point.
    ///
    /// # Errors
    /// If the property has another type.
    pub fn point(&self, name: &'static str) -> Result<Option<DVec3>> {
        self.typed(name, "a point", |value| match value {
            Value::Vector(v) => Some(*v),
            _ => None,
        })
    }

    /// Returns `to_world`, or the identity.
    ///
    /// # Errors
    /// If the property has another type, or changes over time.
    pub fn to_world(&self) -> Result<DAffine3> {
        match self.motion()?.fixed() {
            Some(transform) => Ok(transform),
            None => Err(self.error("to_world", "it cannot move")),
        }
    }

    /// Returns a transformation that does not change over time, or the identity.
    ///
    /// # Errors
    /// If the property has another type.
    pub fn transform(&self, name: &'static str) -> Result<DAffine3> {
        let value = self.typed(name, "a transform", |value| match value {
            Value::Transform(v) => Some(*v),
            _ => None,
        })?;
        Ok(value.unwrap_or(DAffine3::IDENTITY))
    }

    /// Returns `to_world`, which may change over time, or the identity.
    ///
    /// # Errors
    /// If the property has another type.
    pub fn motion(&self) -> Result<Motion> {
        let value = self.typed("to_world", "a transform", |value| match value {
            Value::Transform(v) => Some(Motion::from(*v)),
            Value::Animation(v) => Some(v.clone()),
            _ => None,
        })?;
        Ok(value.unwrap_or_default())
    }

    /// Records a lookup for the test of the documentation.
    #[cfg(test)]
    fn record(&self, name: &str) {
        let Object { class, plugin, .. } = self.object;
        RECORD.with_borrow_mut(|record| record.insert([class, plugin, name].map(str::to_owned)));
    }

    #[cfg(not(test))]
    fn record(&self, _: &str) {}

    fn typed<T>(
        &self,
        name: &'static str,
        expected: &str,
        get: impl Fn(&'g Value) -> Option<T>,
    ) -> Result<Option<T>> {
        let Some(property) = self.find(name) else { return Ok(None) };
        match get(&property.value) {
            Some(value) => Ok(Some(value)),
            None => Err(property.error(format!("expected {expected}, found a {}", property.tag))),
        }
    }

    /// Creates an error about a property, or about the object if it has no property of the name.
    pub fn error(&self, name: &'static str, message: &str) -> Error {
        match self.object.properties.iter().find(|p| p.name == name) {
            Some(property) => property.error(message),
            None => self.object.error(format!("{name}: {message}")),
        }
    }

    /// Creates the error for a property with an invalid value: the expected and the found value.
    pub fn refusal(&self, name: &'static str, expected: &str) -> Error {
        let property = self.object.properties.iter().find(|p| p.name == name);
        let found = match property.map(|p| &p.value) {
            Some(Value::Integer(v)) => v.to_string(),
            Some(Value::Float(v)) => v.to_string(),
            Some(Value::Text(v)) => quoted(v),
            Some(Value::Vector(v)) => format!("{}, {}, {}", v.x, v.y, v.z),
            _ => return self.error(name, expected),
        };
        self.error(name, &format!("{expected}, found {found}"))
    }

    /// Returns the objects of a class inside the object.
    pub fn children(&self, class: &str) -> Vec<&'g Child> {
        let of_class = |(_, child): &(usize, &'g Child)| self.graph.objects[child.object].class == class;
        let found = self.object.children.iter().enumerate().filter(of_class);
        found.inspect(|(i, _)| self.used_children[*i].set(true)).map(|(_, child)| child).collect()
    }

    /// Returns the object of a class inside the object, if there is one.
    ///
    /// # Errors
    /// If there are several.
    pub fn child(&self, class: &str) -> Result<Option<ObjectId>> {
        match self.children(class)[..] {
            [] => Ok(None),
            [child] => Ok(Some(child.object)),
            [_, second, ..] => {
                let error = self.graph.objects[second.object]
                    .error(format!("{} has room for one {class}", self.object.thing()));
                Err(error.at(second.spot.place()))
            }
        }
    }

    /// Returns the child of a name, such as a texture.
    pub fn named_child(&self, name: &'static str) -> Option<ObjectId> {
        self.record(name);
        self.looked_up.borrow_mut().push(name);
        let i = self.object.children.iter().position(|c| c.name.as_deref() == Some(name))?;
        self.used_children[i].set(true);
        Some(self.object.children[i].object)
    }

    /// Returns warnings about the properties and children that were never looked up.
    pub fn finish(self) -> Vec<Error> {
        let looked_up = self.looked_up.into_inner();
        let thing = self.object.thing();
        let properties = self.object.properties.iter().zip(&self.used).filter(|(_, used)| !used.get());
        let properties = properties.map(|(property, _)| {
            let near = wording::did_you_mean(&property.name, looked_up.iter().copied());
            property.error(format!("{thing} has no such property{near}"))
        });
        let children = self.object.children.iter().zip(&self.used_children).filter(|(_, used)| !used.get());
        let children = children.map(|(child, _)| {
            self.graph.objects[child.object]
                .error(format!("{thing} has no use for it"))
                .at(child.spot.place())
        });
        properties.chain(children).collect()
    }
}
