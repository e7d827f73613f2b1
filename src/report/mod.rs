//! Reports: tables for a terminal, and a self-contained HTML page.
//!
//! The module presents images and numbers, and does not depend on their origin.
//!
//! - [`Page`] arranges [`Html`] in sections; style and script are in the file, light and dark follow the reader's
//!   system.
//! - [`Table`] is text for a terminal and mark-up for a page.
//! - [`Plot`] and [`Bars`] are SVG.
//! - [`Viewer`] shows images beside each other; [`thumbnail`] and [`error_thumbnail`] create small images, and
//!   [`gallery`] shows them.

mod bars;
mod gallery;
mod html;
pub mod machine;
mod page;
mod pixels;
mod plot;
mod scale;
mod table;
mod viewer;

pub use bars::{Bar, Bars};
pub use gallery::{Picture, gallery};
pub use html::{Html, escape};
pub use page::{Page, STAGE, STYLE};
pub use pixels::{HEAT_DECADES, HEAT_MAX, error_thumbnail, thumbnail};
pub use plot::{Axis, Line, Plot, Point, Series};
pub use scale::{Scale, number};
pub use table::{Align, Table};
pub use viewer::{MOST_PIXELS, Viewer, exposure_of};
