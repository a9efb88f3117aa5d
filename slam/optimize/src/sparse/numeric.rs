//! The numbers: matrix, factor, solution.

use nalgebra::{Cholesky, Const, DimMin, SMatrix, SVector};

use super::symbolic::{BlockPattern, Symbolic};

/// A symmetric matrix of `N`x`N` blocks over a [`BlockPattern`], its lower triangle.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockMatrix<const N: usize> {
    /// Symmetric blocks of the diagonal, by variable.
    pub diagonal: Vec<SMatrix<f64, N, N>>,
    /// Block (row, column) for every pair `(column, row)` of the pattern, in its order.
    pub lower: Vec<SMatrix<f64, N, N>>,
}

impl<const N: usize> BlockMatrix<N> {
    /// All blocks zero.
    #[must_use]
    pub fn zeros(pattern: &BlockPattern) -> Self {
        Self { diagonal: vec![SMatrix::zeros(); pattern.size()], lower: vec![SMatrix::zeros(); pattern.pairs().len()] }
    }

    /// Sets every block to zero.
    pub fn clear(&mut self) {
        self.diagonal.fill(SMatrix::zeros());
        self.lower.fill(SMatrix::zeros());
    }
}

/// A matrix without a Cholesky factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the matrix is not positive definite at variable {variable}: nothing ties it down")]
pub struct NotPositiveDefinite {
    /// The variable whose pivot is not positive definite or not finite: nothing ties it down.
    pub variable: usize,
}

/// `L` of `P A P^T = L L^T`, in storage that is used again for every matrix of the same pattern.
#[derive(Debug, Clone)]
pub struct SparseCholesky<const N: usize> {
    symbolic: Symbolic,
    /// Blocks in the order of [`Symbolic::rows`]; those of the diagonal are lower triangular.
    blocks: Vec<SMatrix<f64, N, N>>,
    /// Blocks of the pattern, the diagonal counted.
    given: usize,
}

impl<const N: usize> SparseCholesky<N>
where
    Const<N>: DimMin<Const<N>, Output = Const<N>>,
{
    /// Orders the variables and reserves the factor. Memory: `8 N^2` bytes for each of [`blocks`](Self::blocks).
    #[must_use]
    pub fn new(pattern: &BlockPattern) -> Self {
        let symbolic = Symbolic::new(pattern);
        let blocks = vec![SMatrix::zeros(); symbolic.rows.len()];
        Self { symbolic, blocks, given: pattern.size() + pattern.pairs().len() }
    }

    /// Number of blocks of the factor.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Blocks of the factor that the matrix does not have.
    #[must_use]
    pub fn fill_in(&self) -> usize {
        self.blocks.len() - self.given
    }

    /// Factors a matrix of the pattern given to [`new`](Self::new).
    ///
    /// # Errors
    /// When a pivot is not positive definite or not finite. There is no factor then.
    pub fn factor(&mut self, matrix: &BlockMatrix<N>) -> Result<(), NotPositiveDefinite> {
        self.load(matrix);
        // Where in the current column a row stands.
        let mut place = vec![0; self.symbolic.columns.len()];
        for (column, range) in self.symbolic.columns.iter().enumerate() {
            let rows = &self.symbolic.rows;
            for at in range.clone() {
                place[rows[at] as usize] = at - range.start;
            }
            let (done, rest) = self.blocks.split_at_mut(range.start);
            let own = &mut rest[..range.len()];
            for &(earlier, at) in &self.symbolic.left[column] {
                let pivot = done[at];
                for below in at..self.symbolic.columns[earlier as usize].end {
                    subtract_product(&mut own[place[rows[below] as usize]], &done[below], &pivot);
                }
            }
            let refused = || NotPositiveDefinite { variable: self.symbolic.order[column] as usize };
            let lower = Cholesky::new(own[0]).ok_or_else(refused)?.unpack();
            let inverse = lower.solve_lower_triangular(&SMatrix::identity()).ok_or_else(refused)?;
            own[0] = lower;
            for block in &mut own[1..] {
                *block *= inverse.transpose();
            }
        }
        Ok(())
    }

    fn load(&mut self, matrix: &BlockMatrix<N>) {
        self.blocks.fill(SMatrix::zeros());
        for (range, &variable) in self.symbolic.columns.iter().zip(&self.symbolic.order) {
            self.blocks[range.start] = matrix.diagonal[variable as usize];
        }
        for (slot, block) in self.symbolic.slots.iter().zip(&matrix.lower) {
            self.blocks[slot.at] = if slot.transposed { block.transpose() } else { *block };
        }
    }

    /// Solves `A x = right` with the factor made last, by variable.
    #[must_use]
    pub fn solve(&self, right: &[SVector<f64, N>]) -> Vec<SVector<f64, N>> {
        let Symbolic { order, columns, rows, .. } = &self.symbolic;
        let mut x: Vec<SVector<f64, N>> = order.iter().map(|variable| right[*variable as usize]).collect();
        for (column, range) in columns.iter().enumerate() {
            self.blocks[range.start].solve_lower_triangular_mut(&mut x[column]);
            let solved = x[column];
            for at in range.start + 1..range.end {
                x[rows[at] as usize] -= self.blocks[at] * solved;
            }
        }
        for (column, range) in columns.iter().enumerate().rev() {
            for at in range.start + 1..range.end {
                let below = self.blocks[at].tr_mul(&x[rows[at] as usize]);
                x[column] -= below;
            }
            self.blocks[range.start].tr_solve_lower_triangular_mut(&mut x[column]);
        }
        let mut solution = vec![SVector::zeros(); x.len()];
        for (value, &variable) in x.iter().zip(order) {
            solution[variable as usize] = *value;
        }
        solution
    }
}

/// `out -= a * b^T`, laid out so that the compiler works on whole columns.
#[inline]
pub(crate) fn subtract_product<const R: usize, const K: usize>(
    out: &mut SMatrix<f64, R, R>,
    a: &SMatrix<f64, R, K>,
    b: &SMatrix<f64, R, K>,
) {
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
    use proptest::prelude::*;
    use slam_math::Rng;

    /// A positive definite matrix of the pattern: diagonally dominant, with random blocks.
    fn random_matrix<const N: usize>(pattern: &BlockPattern, rng: &mut Rng) -> BlockMatrix<N> {
        let mut matrix = BlockMatrix::<N>::zeros(pattern);
        for (at, &(column, row)) in pattern.pairs().iter().enumerate() {
            let block = SMatrix::<f64, N, N>::from_fn(|_, _| rng.normal());
            matrix.lower[at] = block;
            // [I B^T; B B B^T] is positive semidefinite for any B.
            matrix.diagonal[column as usize] += SMatrix::identity();
            matrix.diagonal[row as usize] += block * block.transpose();
        }
        for block in &mut matrix.diagonal {
            let root = SMatrix::<f64, N, N>::from_fn(|_, _| rng.normal());
            *block += root * root.transpose() + SMatrix::identity() * 0.1;
        }
        matrix
    }

    fn dense<const N: usize>(pattern: &BlockPattern, matrix: &BlockMatrix<N>) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(N * pattern.size(), N * pattern.size());
        for (i, block) in matrix.diagonal.iter().enumerate() {
            out.view_mut((N * i, N * i), (N, N)).copy_from(block);
        }
        for (&(column, row), block) in pattern.pairs().iter().zip(&matrix.lower) {
            let (c, r) = (N * column as usize, N * row as usize);
            out.view_mut((r, c), (N, N)).copy_from(block);
            out.view_mut((c, r), (N, N)).copy_from(&block.transpose());
        }
        out
    }

    fn check<const N: usize>(size: usize, pairs: &[(u32, u32)], seed: u64)
    where
        Const<N>: DimMin<Const<N>, Output = Const<N>>,
    {
        let mut rng = Rng::at(seed, N as u32, 0, 0);
        let pattern = BlockPattern::new(size, pairs.iter().copied());
        let mut factor = SparseCholesky::<N>::new(&pattern);
        // Twice: the storage is used again.
        for _ in 0..2 {
            let matrix = random_matrix::<N>(&pattern, &mut rng);
            let right: Vec<_> = (0..size).map(|_| SVector::<f64, N>::from_fn(|_, _| rng.normal())).collect();
            factor.factor(&matrix).unwrap();
            let x = factor.solve(&right);
            let flat =
                |v: &[SVector<f64, N>]| DVector::from_iterator(N * size, v.iter().flat_map(|b| b.iter().copied()));
            let expected = dense(&pattern, &matrix).cholesky().unwrap().solve(&flat(&right));
            assert!((flat(&x) - &expected).norm() < 1e-8 * (1.0 + expected.norm()));
        }
        let mut again = SparseCholesky::<N>::new(&pattern);
        let matrix = random_matrix::<N>(&pattern, &mut Rng::at(9, 0, 0, 0));
        again.factor(&matrix).unwrap();
        factor.factor(&matrix).unwrap();
        assert_eq!(factor.blocks, again.blocks);
        assert_eq!(factor.blocks(), size + pattern.pairs().len() + factor.fill_in());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn agrees_with_a_dense_factorisation(
            size in 1..24usize,
            ends in proptest::collection::vec((0..24u32, 0..24u32), 0..60),
            seed: u64,
        ) {
            let pairs: Vec<_> = ends.iter().map(|(a, b)| (a % size as u32, b % size as u32)).collect();
            check::<6>(size, &pairs, seed);
            check::<7>(size, &pairs, seed);
        }
    }

    #[test]
    fn a_chain_fills_nothing_and_loops_fill_in_proportion() {
        for n in [100, 1000, 4000] {
            let chain: Vec<_> = (1..n).map(|i| (i - 1, i)).collect();
            let blocks = |pairs: &[(u32, u32)]| {
                let pattern = BlockPattern::new(n as usize, pairs.iter().copied());
                SparseCholesky::<6>::new(&pattern).fill_in()
            };
            assert_eq!(blocks(&chain), 0);
            // A closed ring, and a shortcut every 50 keyframes back to 30 before.
            let mut looped = chain.clone();
            looped.push((0, n - 1));
            looped.extend((50..n).step_by(50).map(|i| (i, i - 30)));
            assert!(blocks(&looped) < 3 * n as usize, "{} for {n}", blocks(&looped));
        }
    }

    /// What a map with loops looks like to bundle adjustment: everyone shares points with the seven before, and every
    /// hundred keyframes eight in a row with eight of a place seen before; the ends meet.
    #[test]
    fn a_band_with_loops_grows_linearly() {
        let blocks_a_keyframe = |n: u32| {
            let near = (0..n).flat_map(|i| (1..8).map(move |step| (i, (i + step) % n)));
            let again = (100..n - 8).step_by(100).flat_map(|i| (0..64).map(move |k| (i + k / 8, i - 60 + k % 8)));
            let pattern = BlockPattern::new(n as usize, near.chain(again));
            SparseCholesky::<6>::new(&pattern).blocks() as f64 / f64::from(n)
        };
        let [small, large] = [1000, 8000].map(blocks_a_keyframe);
        assert!(large < 1.1 * small && large < 25.0, "{small} and {large} blocks a keyframe");
    }

    #[test]
    fn indefinite_or_broken_matrices_name_the_variable() {
        let pattern = BlockPattern::new(3, [(0, 1), (1, 2)]);
        let mut matrix = BlockMatrix::<6>::zeros(&pattern);
        matrix.diagonal.fill(SMatrix::identity());
        let mut factor = SparseCholesky::new(&pattern);
        assert_eq!(factor.factor(&matrix), Ok(()));
        matrix.diagonal[2] = -SMatrix::<f64, 6, 6>::identity();
        assert_eq!(factor.factor(&matrix), Err(NotPositiveDefinite { variable: 2 }));
        matrix.diagonal[2] = SMatrix::identity();
        matrix.lower[0][(3, 3)] = f64::NAN;
        let error = factor.factor(&matrix).unwrap_err();
        assert!(error.to_string().contains("variable"), "{error}");
        matrix.lower[0] = SMatrix::zeros();
        assert_eq!(factor.factor(&matrix), Ok(()));
    }
}
