//! Mathematics: frames, rays with offset origins, bounds, error bounds, compensated sums.

pub mod bounds;
pub mod frame;
pub mod functions;
pub mod lanes;
pub mod motion;
pub mod octahedral;
pub mod ray;
pub mod robust;
pub mod sum;

pub use bounds::Bounds;
pub use frame::{Frame, FrameX16};
pub use glam::{Affine2, DAffine3, DMat3, DMat4, DQuat, DVec2, DVec3, Mat3, Vec2, Vec3};
pub use lanes::{LANES, Vec3x16, f32x16};
pub use motion::Motion;
pub use ray::{Ray, RayX16};
pub use sum::Sum;
