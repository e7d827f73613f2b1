//! The scene: described as plain data, compiled to arrays and ids.

pub mod description;
