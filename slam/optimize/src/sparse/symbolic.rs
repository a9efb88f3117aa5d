//! The structure of the factor: what depends on the pattern and not on the numbers.

use std::ops::Range;

use super::ordering::minimum_degree;

/// A symmetric pattern of blocks: which pairs of variables are tied. The diagonal is always there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockPattern {
    size: usize,
    /// Sorted pairs (column, row) with row > column.
    pairs: Vec<(u32, u32)>,
    /// First pair of every column, and the end.
    starts: Vec<u32>,
}

impl BlockPattern {
    /// From pairs of tied variables in any order, repeated or not; pairs of a variable with itself are dropped.
    ///
    /// # Panics
    /// When a pair names a variable that is not below `size`: a bug of the caller.
    #[must_use]
    pub fn new(size: usize, pairs: impl IntoIterator<Item = (u32, u32)>) -> Self {
        let ordered = pairs.into_iter().filter(|(a, b)| a != b).map(|(a, b)| (a.min(b), a.max(b)));
        let mut pairs: Vec<(u32, u32)> = ordered.collect();
        pairs.sort_unstable();
        pairs.dedup();
        assert!(pairs.iter().all(|(_, row)| (*row as usize) < size), "a pair beyond {size} variables");
        let mut starts = vec![0; size + 1];
        for &(column, _) in &pairs {
            starts[column as usize + 1] += 1;
        }
        for column in 0..size {
            starts[column + 1] += starts[column];
        }
        Self { size, pairs, starts }
    }

    /// Number of variables.
    #[must_use]
    pub fn size(&self) -> usize {
        self.size
    }

    /// Tied pairs `(column, row)` with row > column, sorted: the order of [`BlockMatrix::lower`](super::BlockMatrix).
    #[must_use]
    pub fn pairs(&self) -> &[(u32, u32)] {
        &self.pairs
    }

    /// Position of a pair in [`pairs`](Self::pairs), whichever variable is named first; both below
    /// [`size`](Self::size).
    #[must_use]
    pub fn find(&self, a: u32, b: u32) -> Option<usize> {
        let (column, row) = (a.min(b) as usize, a.max(b));
        let start = self.starts[column] as usize;
        let rows = &self.pairs[start..self.starts[column + 1] as usize];
        rows.binary_search_by_key(&row, |(_, row)| *row).ok().map(|at| start + at)
    }
}

/// Where a block of the matrix goes in the factor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slot {
    pub at: usize,
    /// The permutation swapped its row and column.
    pub transposed: bool,
}

/// The factor's structure, by columns in elimination order.
#[derive(Debug, Clone)]
pub(super) struct Symbolic {
    /// Position in the elimination order to variable.
    pub order: Vec<u32>,
    /// Blocks of each column, the diagonal first.
    pub columns: Vec<Range<usize>>,
    /// Row of each block, ascending in a column.
    pub rows: Vec<u32>,
    /// Per row: the earlier columns that have a block in it and the block's place, ascending by column.
    pub left: Vec<Vec<(u32, usize)>>,
    /// Per pair of the pattern.
    pub slots: Vec<Slot>,
}

impl Symbolic {
    pub fn new(pattern: &BlockPattern) -> Self {
        let mut adjacency = vec![Vec::new(); pattern.size];
        for &(a, b) in &pattern.pairs {
            adjacency[a as usize].push(b);
            adjacency[b as usize].push(a);
        }
        let order = minimum_degree(adjacency);
        let mut position = vec![0; order.len()];
        for (at, &variable) in order.iter().enumerate() {
            position[variable as usize] = at as u32;
        }
        let permuted: Vec<(u32, u32)> =
            pattern.pairs.iter().map(|(a, b)| (position[*a as usize], position[*b as usize])).collect();
        let mut symbolic = Self::fill_in(order, &permuted);
        for &(a, b) in &permuted {
            let column = symbolic.columns[a.min(b) as usize].clone();
            let offset = symbolic.rows[column.clone()].partition_point(|row| *row < a.max(b));
            symbolic.slots.push(Slot { at: column.start + offset, transposed: b < a });
        }
        symbolic
    }

    /// A column's rows are its own and those of its children in the elimination tree (George and Liu 1981, chapter 5).
    fn fill_in(order: Vec<u32>, permuted: &[(u32, u32)]) -> Self {
        let n = order.len();
        let mut structure: Vec<Vec<u32>> = vec![Vec::new(); n];
        for (a, b) in permuted {
            structure[*a.min(b) as usize].push(*a.max(b));
        }
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); n];
        let mut symbolic = Self {
            order,
            columns: Vec::with_capacity(n),
            rows: Vec::new(),
            left: vec![Vec::new(); n],
            slots: Vec::with_capacity(permuted.len()),
        };
        for column in 0..n {
            let mut own = std::mem::take(&mut structure[column]);
            for &child in &children[column] {
                own.extend(symbolic.rows[symbolic.columns[child].clone()].iter().filter(|r| **r as usize > column));
            }
            own.sort_unstable();
            own.dedup();
            if let Some(&parent) = own.first() {
                children[parent as usize].push(column);
            }
            let start = symbolic.rows.len();
            symbolic.rows.push(column as u32);
            for (at, &row) in own.iter().enumerate() {
                symbolic.left[row as usize].push((column as u32, start + 1 + at));
            }
            symbolic.rows.extend(own);
            symbolic.columns.push(start..symbolic.rows.len());
        }
        symbolic
    }
}
