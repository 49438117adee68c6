//! Protocols as pictures: SVG with a layout of our own, and text for Graphviz and Mermaid.
//!
//! What the file declares is drawn; default transitions are not, but a picture says that they are
//! there.

mod arrange;
mod graph;
mod layers;
mod place;
mod svg;
mod text;

pub use svg::svg;
pub use text::{dot, mermaid};
