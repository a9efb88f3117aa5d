//! The order in which variables are eliminated: minimum degree on the quotient graph.
//!
//! Amestoy, Davis and Duff 1996, "An approximate minimum degree ordering algorithm", in its plain form: eliminated
//! variables become elements, an element swallows the elements it is made of, and the degree of a variable is bounded by
//! the sizes of its elements outside the newest, so no fill is ever formed. Ties go to the smallest index: the order is a function of the
//! pattern alone. A chain is eliminated from its ends and fills nothing.

use std::collections::BTreeSet;

struct QuotientGraph {
    /// Per live variable: neighbours not yet hidden in an element.
    variables: Vec<Vec<u32>>,
    /// Per live variable: elements it touches.
    elements: Vec<Vec<u32>>,
    /// Per element, by the variable it was made from: live variables of its clique. Empty once swallowed.
    cliques: Vec<Vec<u32>>,
    /// Per variable: last step in whose clique it was.
    mark: Vec<u32>,
    /// Per element: how much of its clique lies outside the newest one; valid where `outside_at` is the step.
    outside: Vec<usize>,
    outside_at: Vec<u32>,
}

/// Elimination order of a graph given by adjacency lists: position to variable.
pub(super) fn minimum_degree(adjacency: Vec<Vec<u32>>) -> Vec<u32> {
    let n = adjacency.len();
    let mut degree: Vec<usize> = adjacency.iter().map(Vec::len).collect();
    let mut queue: BTreeSet<(usize, u32)> = degree.iter().copied().zip(0..).collect();
    let mut graph = QuotientGraph {
        variables: adjacency,
        elements: vec![Vec::new(); n],
        cliques: vec![Vec::new(); n],
        mark: vec![u32::MAX; n],
        outside: vec![0; n],
        outside_at: vec![u32::MAX; n],
    };
    let mut order = Vec::with_capacity(n);
    while let Some((_, pivot)) = queue.pop_first() {
        for (variable, bound) in graph.eliminate(pivot, order.len() as u32) {
            let last = std::mem::replace(&mut degree[variable as usize], bound);
            if last != bound {
                queue.remove(&(last, variable));
                queue.insert((bound, variable));
            }
        }
        order.push(pivot);
    }
    order
}

impl QuotientGraph {
    /// Makes an element of a variable: its neighbours, direct and through elements, become one clique. Returns them with
    /// the new bounds of their degrees.
    fn eliminate(&mut self, pivot: u32, step: u32) -> Vec<(u32, usize)> {
        let clique = self.form_clique(pivot, step);
        self.measure_outside(&clique, step);
        let mut bounds = Vec::with_capacity(clique.len());
        for &variable in &clique {
            let v = variable as usize;
            let (mark, outside) = (&self.mark, &self.outside);
            // What the clique holds need not be kept as a direct neighbour too, nor an element that lies inside it.
            self.variables[v].retain(|other| mark[*other as usize] != step);
            self.elements[v].retain(|element| outside[*element as usize] > 0);
            let elsewhere: usize = self.elements[v].iter().map(|element| outside[*element as usize]).sum();
            bounds.push((variable, clique.len() - 1 + self.variables[v].len() + elsewhere));
            self.elements[v].push(pivot);
        }
        self.cliques[pivot as usize] = clique;
        bounds
    }

    fn form_clique(&mut self, pivot: u32, step: u32) -> Vec<u32> {
        self.mark[pivot as usize] = step;
        let mut members = std::mem::take(&mut self.variables[pivot as usize]);
        for element in std::mem::take(&mut self.elements[pivot as usize]) {
            members.append(&mut self.cliques[element as usize]);
        }
        members.retain(|member| std::mem::replace(&mut self.mark[*member as usize], step) != step);
        members
    }

    fn measure_outside(&mut self, clique: &[u32], step: u32) {
        for &variable in clique {
            for &element in &self.elements[variable as usize] {
                let e = element as usize;
                if std::mem::replace(&mut self.outside_at[e], step) != step {
                    self.outside[e] = self.cliques[e].len();
                }
                // Swallowed elements are empty.
                self.outside[e] = self.outside[e].saturating_sub(1);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(n: usize, edges: &[(u32, u32)]) -> Vec<Vec<u32>> {
        let mut adjacency = vec![Vec::new(); n];
        for &(a, b) in edges {
            adjacency[a as usize].push(b);
            adjacency[b as usize].push(a);
        }
        adjacency.iter_mut().for_each(|list| list.sort_unstable());
        adjacency
    }

    #[test]
    fn a_chain_is_eliminated_from_its_end_and_a_star_from_its_leaves() {
        let chain: Vec<(u32, u32)> = (0..9).map(|i| (i, i + 1)).collect();
        assert_eq!(minimum_degree(graph(10, &chain)), (0..10).collect::<Vec<u32>>());
        let star: Vec<(u32, u32)> = (1..6).map(|i| (0, i)).collect();
        let order = minimum_degree(graph(6, &star));
        // The hub may go when one leaf is left: then it is a leaf as well.
        assert_eq!(order[..4], [1, 2, 3, 4]);
    }

    #[test]
    fn every_variable_appears_once_also_without_edges() {
        assert_eq!(minimum_degree(graph(3, &[])), [0, 1, 2]);
        assert!(minimum_degree(Vec::new()).is_empty());
    }
}
