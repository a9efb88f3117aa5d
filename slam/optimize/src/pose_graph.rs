//! Pose graphs: poses tied by relative poses, over rigid transforms or similarities.
//!
//! Levenberg-Marquardt on the group, normal equations by the block-sparse solver (Kümmerle et al. 2011, "g2o"; Strasdat et
//! al. 2010, "Scale Drift-Aware Large Scale Monocular SLAM" for the similarities). The residual of an edge is
//! `log(to_from_from * from_pose * to_pose^-1)`, in the frame of `to`. Time and memory grow about linearly with the length
//! of a chain.
//!
//! The gauge is explicit: every connected part needs a vertex that is held, and it is an error when one has none.

use nalgebra::{Const, DimMin, SMatrix, SVector};
use slam_math::lie::left_jacobian_inverse;
use slam_math::{LieGroup, par};

use crate::gauge::loose_part;
use crate::levenberg::{Budget, Damping, Trial, minimize};
use crate::robust::Kernel;
use crate::sparse::{BlockMatrix, BlockPattern, SparseCholesky};

/// Edges that are linearised before they are added up: bounds the memory between the two.
const WINDOW: usize = 1024;

/// A pose of the graph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex<G> {
    /// The estimate, `vertex_from_world`.
    pub pose: G,
    /// Held as it is.
    pub fixed: bool,
}

/// A relative pose between two vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge<G, const N: usize> {
    /// Index into [`PoseGraph::vertices`].
    pub from: u32,
    /// Index into [`PoseGraph::vertices`], another one.
    pub to: u32,
    /// What the edge says: `to.pose * from.pose^-1`.
    pub to_from_from: G,
    /// Inverse covariance of the residual `[translation, rotation(, log scale)]`, symmetric and positive semidefinite.
    pub information: SMatrix<f64, N, N>,
    /// What a wrong edge can do: a plain square for odometry, Huber's for a loop that might be wrong.
    pub kernel: Kernel,
}

/// Poses and what ties them. `N` is 6 with `Se3`, 7 with `Sim3`. [`optimize_pose_graph`] changes the poses in place.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseGraph<G, const N: usize> {
    /// The poses.
    pub vertices: Vec<Vertex<G>>,
    /// In any order; the order of the input is the order of the sums.
    pub edges: Vec<Edge<G, N>>,
}

/// Budget of [`optimize_pose_graph`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGraphOptions {
    /// Most linear solves, accepted or not: 20 as in ORB-SLAM (Mur-Artal et al. 2015, section VII).
    pub iterations: u32,
    /// The search ends when the cost decreases by less than this share of itself.
    pub relative_decrease: f64,
    /// First factor on the diagonal. Small: relative poses are almost linear.
    pub initial_damping: f64,
}

impl Default for PoseGraphOptions {
    fn default() -> Self {
        Self { iterations: 20, relative_decrease: 1e-6, initial_damping: 1e-8 }
    }
}

/// What [`optimize_pose_graph`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGraphReport {
    /// Robust cost before.
    pub initial_cost: f64,
    /// Robust cost after.
    pub final_cost: f64,
    /// Linear solves.
    pub iterations: u32,
    /// How many of them gave a step that was taken.
    pub accepted: u32,
    /// The cost no longer changed. False: out of iterations.
    pub converged: bool,
    /// Blocks of the factor that the normal equations do not have.
    pub fill_in: usize,
}

/// A graph that can't be optimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PoseGraphError {
    /// An edge names a vertex that is not there, or one vertex twice.
    #[error("edge {edge} ties vertices {from} and {to}; it needs two different ones of the {vertices} there are")]
    BadEdge {
        /// Index of the edge.
        edge: usize,
        /// As given.
        from: u32,
        /// As given.
        to: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A pose, a relative pose or an information has a number that is not finite (or a scale that is not above zero).
    #[error("{what} {index} of the pose graph has a number that is not finite")]
    NotFinite {
        /// `"vertex"` or `"edge"`.
        what: &'static str,
        /// Its index.
        index: usize,
    },
    /// A connected part has no fixed vertex, so nothing says where it is.
    #[error(
        "the part of {size} vertices around vertex {vertex} is tied to no fixed vertex: fix one of them or leave it out"
    )]
    Loose {
        /// Its smallest vertex.
        vertex: usize,
        /// Number of vertices.
        size: usize,
    },
}

/// Minimises the robust squared residuals of all edges over the vertices that are not fixed.
///
/// # Errors
/// When an edge is malformed, a number is not finite, or a connected part has no fixed vertex. The graph is then as it was.
pub fn optimize_pose_graph<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    options: &PoseGraphOptions,
) -> Result<PoseGraphReport, PoseGraphError>
where
    Const<N>: DimMin<Const<N>, Output = Const<N>>,
{
    check(graph)?;
    let system = System::new(graph);
    let mut factor = SparseCholesky::new(&system.pattern);
    let mut poses: Vec<G> = graph.vertices.iter().map(|v| v.pose).collect();
    let cost = system.cost(&poses);
    let budget = Budget {
        iterations: options.iterations,
        relative_decrease: options.relative_decrease,
        initial_damping: options.initial_damping,
    };
    let solve =
        |poses: &Vec<G>, linear: &Normal<N>, damping: &Damping| system.step(&mut factor, poses, linear, damping);
    let outcome = minimize(&mut poses, cost, budget, |poses| system.linearize(poses), solve);
    for (vertex, pose) in graph.vertices.iter_mut().zip(poses).filter(|(v, _)| !v.fixed) {
        vertex.pose = pose.normalized();
    }
    Ok(PoseGraphReport {
        initial_cost: outcome.initial_cost,
        final_cost: outcome.final_cost,
        iterations: outcome.iterations,
        accepted: outcome.accepted,
        converged: outcome.converged,
        fill_in: factor.fill_in(),
    })
}

fn check<G: LieGroup<N>, const N: usize>(graph: &PoseGraph<G, N>) -> Result<(), PoseGraphError> {
    let vertices = graph.vertices.len();
    if let Some(index) = graph.vertices.iter().position(|v| !v.pose.is_finite()) {
        return Err(PoseGraphError::NotFinite { what: "vertex", index });
    }
    for (edge, e) in graph.edges.iter().enumerate() {
        if e.from == e.to || (e.from.max(e.to) as usize) >= vertices {
            return Err(PoseGraphError::BadEdge { edge, from: e.from, to: e.to, vertices });
        }
        if !e.to_from_from.is_finite() || !e.information.iter().all(|v| v.is_finite()) {
            return Err(PoseGraphError::NotFinite { what: "edge", index: edge });
        }
    }
    let held: Vec<bool> = graph.vertices.iter().map(|v| v.fixed).collect();
    let ties = graph.edges.iter().map(|e| (e.from as usize, e.to as usize));
    match loose_part(&held, ties) {
        Some(part) => Err(PoseGraphError::Loose { vertex: part.first, size: part.size }),
        None => Ok(()),
    }
}

/// Normal equations at one estimate, undamped.
struct Normal<const N: usize> {
    matrix: BlockMatrix<N>,
    gradient: Vec<SVector<f64, N>>,
}

/// What one edge adds to the normal equations.
struct EdgeTerm<const N: usize> {
    from: (SMatrix<f64, N, N>, SVector<f64, N>),
    to: (SMatrix<f64, N, N>, SVector<f64, N>),
    /// Block (row `to`, column `from`).
    between: SMatrix<f64, N, N>,
}

/// Residual of an edge and its derivatives by left perturbations of `from` and `to`.
fn linearized<G: LieGroup<N>, const N: usize>(
    edge: &Edge<G, N>,
    from: &G,
    to: &G,
) -> (SVector<f64, N>, SMatrix<f64, N, N>, SMatrix<f64, N, N>) {
    let residual = (edge.to_from_from * *from * to.inverse()).log();
    // log(Z exp(d) F T^-1) = log(exp(Ad_Z d) E) and log(Z F T^-1 exp(-d)) = log(E exp(-d)).
    let by_from = left_jacobian_inverse::<G, N>(&residual) * edge.to_from_from.adjoint();
    let by_to = -left_jacobian_inverse::<G, N>(&-residual);
    (residual, by_from, by_to)
}

/// Edges and free vertices in the solver's numbering.
struct System<'a, G, const N: usize> {
    graph: &'a PoseGraph<G, N>,
    pattern: BlockPattern,
    /// Per vertex: its variable.
    free: Vec<Option<u32>>,
    /// Per edge between free vertices: its block and whether the block's row is `to`.
    between: Vec<Option<(usize, bool)>>,
}

impl<'a, G: LieGroup<N>, const N: usize> System<'a, G, N>
where
    Const<N>: DimMin<Const<N>, Output = Const<N>>,
{
    fn new(graph: &'a PoseGraph<G, N>) -> Self {
        let mut variables = 0..;
        let free: Vec<Option<u32>> =
            graph.vertices.iter().map(|v| if v.fixed { None } else { variables.next() }).collect();
        let ends = |e: &Edge<G, N>| free[e.from as usize].zip(free[e.to as usize]);
        let size = free.iter().flatten().count();
        let pattern = BlockPattern::new(size, graph.edges.iter().filter_map(ends));
        let place = |e: &Edge<G, N>| {
            let (from, to) = ends(e)?;
            Some((pattern.find(from, to)?, to > from))
        };
        let between = graph.edges.iter().map(place).collect();
        Self { graph, pattern, free, between }
    }

    fn cost(&self, poses: &[G]) -> f64 {
        let chi2 = par::ordered_map(&self.graph.edges, |_, e| {
            let residual = (e.to_from_from * poses[e.from as usize] * poses[e.to as usize].inverse()).log();
            e.kernel.cost(residual.dot(&(e.information * residual)))
        });
        chi2.iter().fold(0.0, |sum, cost| sum + cost)
    }

    fn linearize(&self, poses: &[G]) -> Normal<N> {
        let mut matrix = BlockMatrix::zeros(&self.pattern);
        let mut gradient = vec![SVector::zeros(); self.pattern.size()];
        for (edges, between) in self.graph.edges.chunks(WINDOW).zip(self.between.chunks(WINDOW)) {
            let terms = par::ordered_map(edges, |_, e| edge_term(e, poses));
            for ((edge, between), term) in edges.iter().zip(between).zip(terms) {
                for (vertex, (block, part)) in [(edge.from, term.from), (edge.to, term.to)] {
                    if let Some(variable) = self.free[vertex as usize] {
                        matrix.diagonal[variable as usize] += block;
                        gradient[variable as usize] += part;
                    }
                }
                if let Some((at, row_is_to)) = *between {
                    matrix.lower[at] += if row_is_to { term.between } else { term.between.transpose() };
                }
            }
        }
        Normal { matrix, gradient }
    }

    fn step(
        &self,
        factor: &mut SparseCholesky<N>,
        poses: &[G],
        linear: &Normal<N>,
        damping: &Damping,
    ) -> Option<Trial<Vec<G>>> {
        let mut matrix = linear.matrix.clone();
        let scales: Vec<SVector<f64, N>> =
            matrix.diagonal.iter().map(|block| block.diagonal().map(|d| damping.of(d))).collect();
        for (block, scale) in matrix.diagonal.iter_mut().zip(&scales) {
            *block += SMatrix::from_diagonal(scale);
        }
        factor.factor(&matrix).ok()?;
        let right: Vec<_> = linear.gradient.iter().map(|g| -g).collect();
        let steps = factor.solve(&right);
        let mut predicted = 0.0;
        for ((step, scale), gradient) in steps.iter().zip(&scales).zip(&linear.gradient) {
            predicted += step.dot(&(scale.component_mul(step) - gradient));
        }
        let moved = |(pose, free): (&G, &Option<u32>)| free.map_or(*pose, |v| G::exp(&steps[v as usize]) * *pose);
        let state: Vec<G> = poses.iter().zip(&self.free).map(moved).collect();
        let cost = self.cost(&state);
        Some(Trial { state, cost, predicted })
    }
}

fn edge_term<G: LieGroup<N>, const N: usize>(edge: &Edge<G, N>, poses: &[G]) -> EdgeTerm<N> {
    let (residual, by_from, by_to) = linearized(edge, &poses[edge.from as usize], &poses[edge.to as usize]);
    let weighted = edge.information * residual;
    let information = edge.information * edge.kernel.weight(residual.dot(&weighted));
    let weighted = information * residual;
    let to_information = by_to.transpose() * information;
    EdgeTerm {
        from: (by_from.transpose() * information * by_from, by_from.tr_mul(&weighted)),
        to: (to_information * by_to, by_to.tr_mul(&weighted)),
        between: to_information * by_from,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use slam_math::{Rng, Se3, Sim3};

    fn jacobians_are_finite_differences<G: LieGroup<N>, const N: usize>() {
        let mut rng = Rng::at(1, N as u32, 0, 0);
        for _ in 0..20 {
            let mut random = |spread: f64| G::exp(&SVector::from_fn(|_, _| spread * rng.normal()));
            let (from, to) = (random(0.7), random(0.7));
            let to_from_from = random(0.1) * to * from.inverse();
            let edge = Edge { from: 0, to: 1, to_from_from, information: SMatrix::identity(), kernel: Kernel::Square };
            let (_, by_from, by_to) = linearized(&edge, &from, &to);
            for c in 0..N {
                let mut step = SVector::<f64, N>::zeros();
                step[c] = 1e-6;
                let residual = |from: G, to: G| linearized(&edge, &from, &to).0;
                let (plus, minus) = (G::exp(&step), G::exp(&-step));
                let numeric_from = (residual(plus * from, to) - residual(minus * from, to)) / 2e-6;
                let numeric_to = (residual(from, plus * to) - residual(from, minus * to)) / 2e-6;
                assert!((numeric_from - by_from.column(c)).norm() < 1e-6 * (1.0 + numeric_from.norm()));
                assert!((numeric_to - by_to.column(c)).norm() < 1e-6 * (1.0 + numeric_to.norm()));
            }
        }
    }

    #[test]
    fn jacobians_equal_finite_differences() {
        jacobians_are_finite_differences::<Se3, 6>();
        jacobians_are_finite_differences::<Sim3, 7>();
    }
}
