//! Cholesky factorisation of a symmetric matrix of 6x6 blocks, in the given order.

use nalgebra::{Cholesky, Matrix6, SMatrix, Vector6};
use slam_math::Buffer;

/// `L` of `L L^T`, by columns of blocks.
pub(super) struct BlockCholesky {
    /// Blocks (k, i) for k = i.. ; the first one is lower triangular.
    columns: Buffer<Buffer<Matrix6<f64>>>,
}

impl BlockCholesky {
    /// Factors the matrix whose lower triangle is given as columns: blocks (k, i) for k = i.. . `None` when it is not
    /// positive definite. Blocks that are zero cost nothing.
    pub fn new(mut columns: Buffer<Buffer<Matrix6<f64>>>) -> Option<Self> {
        let mut filled = Vec::with_capacity(columns.len());
        for i in 0..columns.len() {
            let (done, rest) = columns.split_at_mut(i + 1);
            let column = &mut done[i];
            let lower = Cholesky::new(*column.first()?)?.unpack();
            let inverse_transposed = lower.solve_lower_triangular(&Matrix6::identity())?.transpose();
            column[0] = lower;
            for block in &mut column[1..] {
                *block *= inverse_transposed;
            }
            filled.clear();
            filled.extend((1..column.len()).filter(|&k| column[k] != Matrix6::zeros()));
            for (at, &m) in filled.iter().enumerate() {
                for &k in &filled[at..] {
                    subtract_product(&mut rest[m - 1][k - m], &column[k], &column[m]);
                }
            }
        }
        Some(Self { columns })
    }

    /// Solves for one right side.
    pub fn solve(&self, mut right: Buffer<Vector6<f64>>) -> Buffer<Vector6<f64>> {
        for (i, column) in self.columns.iter().enumerate() {
            column[0].solve_lower_triangular_mut(&mut right[i]);
            let solved = right[i];
            for (k, block) in column.iter().enumerate().skip(1) {
                right[i + k] -= block * solved;
            }
        }
        for (i, column) in self.columns.iter().enumerate().rev() {
            for (k, block) in column.iter().enumerate().skip(1) {
                let below = block.tr_mul(&right[i + k]);
                right[i] -= below;
            }
            column[0].tr_solve_lower_triangular_mut(&mut right[i]);
        }
        right
    }
}

/// `out -= a * b^T`, laid out so that the compiler works on whole columns. Inlined, it goes entry by entry, at half the speed.
#[inline(never)]
pub(super) fn subtract_product<const N: usize>(out: &mut Matrix6<f64>, a: &SMatrix<f64, 6, N>, b: &SMatrix<f64, 6, N>) {
    for (c, column) in out.data.0.iter_mut().enumerate() {
        for (a, b) in a.data.0.iter().zip(&b.data.0) {
            for (out, a) in column.iter_mut().zip(a) {
                *out -= a * b[c];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use slam_math::Rng;

    #[test]
    fn agrees_with_a_plain_factorisation_also_with_empty_blocks() {
        let mut rng = Rng::at(1, 0, 0, 0);
        for n in [1, 2, 5, 9] {
            let mut root = DMatrix::from_fn(6 * n, 6 * n, |_, _| rng.normal());
            // A band of blocks: the far corner of the product stays empty.
            for ((r, c), v) in (0..6 * n).flat_map(|c| (0..6 * n).map(move |r| (r, c))).zip(root.iter_mut()) {
                *v = if (r / 6).abs_diff(c / 6) > 1 { 0.0 } else { *v };
            }
            let dense = &root * root.transpose() + DMatrix::identity(6 * n, 6 * n);
            let right = DVector::from_fn(6 * n, |_, _| rng.normal());
            let block = |k: usize, i: usize| Matrix6::from_fn(|r, c| dense[(6 * k + r, 6 * i + c)]);
            let column = |i| Buffer::from((i..n).map(|k| block(k, i)).collect::<Vec<_>>());
            let columns: Vec<_> = (0..n).map(column).collect();
            let b: Vec<_> = (0..n).map(|i| Vector6::from_fn(|r, _| right[6 * i + r])).collect();
            let x = BlockCholesky::new(columns.into()).unwrap().solve(b.into());
            let x = DVector::from_iterator(6 * n, x.iter().flat_map(|v| v.iter().copied()));
            assert!((&dense * x - &right).norm() < 1e-9 * right.norm(), "{n}");
        }
    }

    #[test]
    fn indefinite_or_broken_matrices_are_refused() {
        let single = |block: Matrix6<f64>| Buffer::from(vec![Buffer::from(vec![block])]);
        assert!(BlockCholesky::new(single(-Matrix6::identity())).is_none());
        assert!(BlockCholesky::new(single(Matrix6::repeat(f64::NAN))).is_none());
    }
}
