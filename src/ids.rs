//! Typed indices into the scene's arrays.

/// Declares a `u32` newtype that indexes one of the scene's arrays.
macro_rules! id {
    ($(#[$meta:meta])* $name:ident) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
        pub struct $name(pub u32);

        impl $name {
            /// Returns the index as `usize`.
            #[inline]
            pub fn index(self) -> usize {
                self.0 as usize
            }
        }

        impl From<usize> for $name {
            /// # Panics
            /// If `i` does not fit 32 bits.
            fn from(i: usize) -> Self {
                $name(u32::try_from(i).expect("more than 2^32 entries in a scene array"))
            }
        }
    };
}

id!(
    /// A shape of the scene; also the accelerator's geometry index.
    ShapeId
);
id!(
    /// A material of the scene.
    MaterialId
);
id!(
    /// An emitter of the scene.
    EmitterId
);
id!(
    /// A texture of the scene.
    TextureId
);
id!(
    /// A participating medium of the scene.
    MediumId
);
