//! What rigid transforms and similarities have in common, for solvers over either.

use nalgebra::{SMatrix, SVector, Vector3, Vector6};

use crate::se3::{Se3, skew};

/// A matrix Lie group with tangents of `N` numbers, perturbed from the left: `exp(delta) * x`.
pub trait LieGroup<const N: usize>: Copy + PartialEq + Send + Sync + std::ops::Mul<Output = Self> {
    /// Exponential map.
    #[must_use]
    fn exp(tangent: &SVector<f64, N>) -> Self;
    /// Inverse of the exponential map.
    #[must_use]
    fn log(&self) -> SVector<f64, N>;
    /// The inverse transform.
    #[must_use]
    fn inverse(&self) -> Self;
    /// `Ad` with `x * exp(delta) * x^-1 = exp(Ad delta)`.
    #[must_use]
    fn adjoint(&self) -> SMatrix<f64, N, N>;
    /// `ad`, the derivative of the adjoint: the Lie bracket `[tangent, .]` as a matrix.
    #[must_use]
    fn bracket(tangent: &SVector<f64, N>) -> SMatrix<f64, N, N>;
    /// The same element with its rotation made orthonormal again.
    #[must_use]
    fn normalized(&self) -> Self;
    /// Every number is finite and usable.
    #[must_use]
    fn is_finite(&self) -> bool;
}

impl LieGroup<6> for Se3 {
    fn exp(tangent: &Vector6<f64>) -> Self {
        Self::exp(tangent)
    }

    fn log(&self) -> Vector6<f64> {
        self.log()
    }

    fn inverse(&self) -> Self {
        self.inverse()
    }

    fn adjoint(&self) -> SMatrix<f64, 6, 6> {
        let mut out = SMatrix::<f64, 6, 6>::zeros();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.rotation);
        out.fixed_view_mut::<3, 3>(0, 3).copy_from(&(skew(&self.translation) * self.rotation));
        out.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.rotation);
        out
    }

    fn bracket(tangent: &Vector6<f64>) -> SMatrix<f64, 6, 6> {
        let turn = skew(&Vector3::new(tangent[3], tangent[4], tangent[5]));
        let mut out = SMatrix::<f64, 6, 6>::zeros();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
        out.fixed_view_mut::<3, 3>(0, 3).copy_from(&skew(&Vector3::new(tangent[0], tangent[1], tangent[2])));
        out.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
        out
    }

    fn normalized(&self) -> Self {
        self.normalized()
    }

    fn is_finite(&self) -> bool {
        self.is_finite()
    }
}

/// Inverse left Jacobian: `log(exp(delta) * exp(x)) = x + J delta + O(delta^2)`. The series
/// `I - ad/2 + sum B_2n ad^2n / (2n)!` (Bernoulli numbers) up to the eighth power: off by less than 1e-7 of `ad` for
/// rotations up to one radian and by a hundredth near half a turn, where a Gauss-Newton step is rougher than that anyhow.
#[must_use]
pub fn left_jacobian_inverse<G: LieGroup<N>, const N: usize>(x: &SVector<f64, N>) -> SMatrix<f64, N, N> {
    let ad = G::bracket(x);
    let ad2 = ad * ad;
    let one = SMatrix::<f64, N, N>::identity();
    let even = [-1.0 / 1_209_600.0, 1.0 / 30_240.0, -1.0 / 720.0, 1.0 / 12.0];
    let tail = even[1..].iter().fold(one * even[0], |tail, factor| one * *factor + ad2 * tail);
    one - ad * 0.5 + ad2 * tail
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Rng, Sim3};

    fn laws<G: LieGroup<N>, const N: usize>() {
        let mut rng = Rng::at(1, N as u32, 0, 0);
        for _ in 0..50 {
            let a = SVector::<f64, N>::from_fn(|_, _| rng.uniform() - 0.5);
            let x = G::exp(&SVector::from_fn(|_, _| rng.normal() * 0.6));
            let moved = (x * G::exp(&a) * x.inverse()).log();
            assert!((moved - x.adjoint() * a).norm() < 1e-9 * (1.0 + moved.norm()), "{moved} {}", x.adjoint() * a);
            for c in 0..N {
                let mut step = SVector::<f64, N>::zeros();
                step[c] = 1e-6;
                let at = |sign: f64| (G::exp(&(step * sign)) * G::exp(&a)).log();
                let numeric = (at(1.0) - at(-1.0)) / 2e-6;
                let exact = left_jacobian_inverse::<G, N>(&a).column(c).into_owned();
                assert!((numeric - exact).norm() < 1e-6, "{numeric} {exact}");
                let tangent = (G::exp(&(step * 1.0)).adjoint() - G::exp(&(step * -1.0)).adjoint()) / 2e-6;
                assert!((tangent * a - G::bracket(&(step * 1e6)) * a).norm() < 1e-8);
            }
        }
    }

    #[test]
    fn adjoint_bracket_and_jacobian_equal_their_definitions() {
        laws::<Se3, 6>();
        laws::<Sim3, 7>();
    }
}
