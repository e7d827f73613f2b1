//! Hashes of what is rendered, to know it again: for references and caches that are kept in files.

use crate::scene::description::Description;
use std::fmt::{self, Arguments, Write};
use std::hash::{DefaultHasher, Hasher};

/// Hashes what is written to it.
struct HashWriter(DefaultHasher);

impl Write for HashWriter {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write(text.as_bytes());
        Ok(())
    }
}

/// The hash of a text, which need not be put together.
pub fn of(text: Arguments<'_>) -> u64 {
    let mut writer = HashWriter(DefaultHasher::new());
    // Nothing can fail: neither the writer nor the derived formats do.
    let _ = writer.write_fmt(text);
    writer.0.finish()
}

/// What `f` makes of a scene in which nothing says where it stands in the file.
pub fn without_places<T>(description: &mut Description, f: impl FnOnce(&mut Description) -> T) -> T {
    let mut shapes: Vec<_> =
        description.shapes.iter_mut().chain(description.groups.iter_mut().flatten()).collect();
    let places: Vec<_> = shapes.iter_mut().map(|shape| shape.place.take()).collect();
    let instances: Vec<_> = description.instances.iter_mut().map(|instance| instance.place.take()).collect();
    let result = f(description);
    let shapes = description.shapes.iter_mut().chain(description.groups.iter_mut().flatten());
    shapes.zip(places).for_each(|(shape, place)| shape.place = place);
    description.instances.iter_mut().zip(instances).for_each(|(instance, place)| instance.place = place);
    result
}

/// The hash of a scene, whoever looks at it.
pub fn scene(description: &mut Description) -> u64 {
    without_places(description, |description| {
        let sensors = std::mem::take(&mut description.sensors);
        let hash = of(format_args!("{description:?}"));
        description.sensors = sensors;
        hash
    })
}

/// What samples, records and photons belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Hash of the scene, without sensors.
    pub scene: u64,
    /// Hash of the sensor with its film.
    pub view: u64,
}
