//! Hashes of scenes and settings, which identify stored references and caches.

use crate::scene::description::Description;
use std::fmt::{self, Arguments, Write};
use std::hash::{DefaultHasher, Hasher};

/// A hasher with the interface of a text writer.
struct HashWriter(DefaultHasher);

impl Write for HashWriter {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write(text.as_bytes());
        Ok(())
    }
}

/// Returns the hash of a formatted text, without storing the text.
pub fn of(text: Arguments<'_>) -> u64 {
    let mut writer = HashWriter(DefaultHasher::new());
    // Neither the writer nor derived formatting can fail.
    let _ = writer.write_fmt(text);
    writer.0.finish()
}

/// Applies `f` to a scene without its locations in the scene file.
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

/// Returns the hash of a scene without its sensors.
pub fn scene(description: &mut Description) -> u64 {
    without_places(description, |description| {
        let sensors = std::mem::take(&mut description.sensors);
        let hash = of(format_args!("{description:?}"));
        description.sensors = sensors;
        hash
    })
}

/// The hashes of the scene and view to which samples, records and photons belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneHashes {
    /// Hash of the scene without its sensors.
    pub scene: u64,
    /// Hash of the sensor with its film.
    pub view: u64,
}
