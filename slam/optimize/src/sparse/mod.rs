//! Symmetric positive definite systems of small dense blocks, most of them absent.
//!
//! The pattern is analysed once: a minimum degree order with ties by index, the fill it causes, and where every block
//! goes. Then any number of matrices with that pattern are factored, left-looking, `P A P^T = L L^T` (George and Liu
//! 1981, "Computer Solution of Large Sparse Positive Definite Systems"). Order, sums and result are functions of the input
//! alone. On a chain with a bounded number of neighbours a variable, with or without loops, time and memory grow about
//! linearly with its length.

mod numeric;
mod ordering;
mod symbolic;

pub(crate) use numeric::subtract_product;
pub use numeric::{BlockMatrix, NotPositiveDefinite, SparseCholesky};
pub use symbolic::BlockPattern;
