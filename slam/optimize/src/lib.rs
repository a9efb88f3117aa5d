//! Estimation from geometry: robust non-linear least squares and RANSAC. No map, no images, no I/O.
//!
//! * [`camera`]: the stereo-type pinhole measurement that a depth camera gives, its residual and derivatives.
//! * [`robust`]: kernels that bound what one bad measurement can do.
//! * [`pose`]: pose of one camera from known points.
//! * [`bundle`]: poses and points together, by the Schur complement over the points.
//! * [`sparse`]: block-sparse Cholesky with a fixed elimination order.
//! * [`pose_graph`]: poses tied by relative poses, rigid or with scale.
//! * [`global`]: poses and points of a whole map, by the block-sparse solver.
//! * [`triangulate()`]: a point from two rays.
//! * [`absolute`]: rigid motion or similarity between two point clouds with outliers.
//! * [`similarity`]: the same between two cameras that see what they know: is this the same place?
//! * [`p3p()`]: pose of a camera from points and pixels alone, with outliers.
//! * [`fundamental`]: two-view epipolar geometry with outliers.
//! * [`two_view`]: motion and points from two views without depth, the start of a monocular map.
//!
//! Conventions: metres, radians, undistorted pixels; poses are `camera_from_world`, perturbed from the left,
//! `exp(delta) * camera_from_world`, with `delta = [translation, rotation]`. Costs are sums of squared normalised residuals
//! (chi-square values), without a factor one half. Budgets are counts, sums have a fixed order: results have the same bits
//! on every CPU and for any number of threads. A number that is not finite or a point behind the camera makes its own
//! observation an outlier and touches nothing else.

pub mod absolute;
pub mod bundle;
pub mod camera;
mod cubic;
pub mod fundamental;
mod gauge;
pub mod global;
mod levenberg;
pub mod p3p;
pub mod pose;
pub mod pose_graph;
mod ransac;
pub mod robust;
pub mod similarity;
pub mod sparse;
pub mod triangulate;
pub mod two_view;

pub use absolute::{AbsoluteOptions, absolute_orientation_ransac, similarity_ransac};
pub use bundle::{BaObservation, BaOptions, BaPose, BaProblem, BaReport, bundle_adjust};
pub use camera::{DepthCamera, Measurement, Pinhole};
pub use fundamental::{Fundamental, FundamentalOptions, epipolar_distance, fundamental_ransac, sampson_distance};
pub use global::{GlobalBaReport, LoosePose, global_bundle_adjust};
pub use p3p::{absolute_pose_ransac, p3p};
pub use pose::{PoseEquations, PoseObservation, PoseOptions, PoseResult, optimize_pose, pose_equations};
pub use pose_graph::{Edge, PoseGraph, PoseGraphError, PoseGraphOptions, PoseGraphReport, Vertex, optimize_pose_graph};
pub use robust::Kernel;
pub use similarity::{PointPair, SimilarityOptions, SimilarityResult, find_similarity, refine_similarity};
pub use sparse::{BlockMatrix, BlockPattern, NotPositiveDefinite, SparseCholesky};
pub use triangulate::triangulate;
pub use two_view::{TwoViewFailure, TwoViewModel, TwoViewOptions, TwoViewReconstruction, two_view_reconstruction};
