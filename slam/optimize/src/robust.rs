//! Kernels that bound what one bad measurement can do.

/// How the squared normalised residual of one observation enters the cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kernel {
    /// Plain least squares.
    Square,
    /// Huber's: quadratic up to a chi-square value of `gate`, linear in the residual beyond.
    Huber {
        /// Chi-square value at which the kernel becomes linear, > 0.
        gate: f64,
    },
}

impl Kernel {
    /// Contribution to the cost.
    #[must_use]
    pub fn cost(self, chi2: f64) -> f64 {
        match self {
            Self::Huber { gate } if chi2 > gate => 2.0 * (gate * chi2).sqrt() - gate,
            _ => chi2,
        }
    }

    /// Derivative of the cost by `chi2`: the factor on the observation's information, in (0, 1].
    #[must_use]
    pub fn weight(self, chi2: f64) -> f64 {
        match self {
            Self::Huber { gate } if chi2 > gate => (gate / chi2).sqrt(),
            _ => 1.0,
        }
    }
}

/// Chi-square values above which an observation is an outlier; also where Huber's kernel turns linear.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gates {
    pub mono: f64,
    pub stereo: f64,
}

impl Gates {
    pub fn of(self, stereo: bool) -> f64 {
        if stereo { self.stereo } else { self.mono }
    }

    pub fn kernel(self, robust: bool, stereo: bool) -> Kernel {
        if robust { Kernel::Huber { gate: self.of(stereo) } } else { Kernel::Square }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn huber_is_smooth_at_its_gate_and_its_weight_is_the_derivative() {
        let kernel = Kernel::Huber { gate: 5.991 };
        assert!((kernel.cost(5.991 + 1e-9) - kernel.cost(5.991)).abs() < 2e-9);
        for chi2 in [0.1, 3.0, 5.99, 6.0, 50.0, 1e4] {
            let step = 1e-4;
            let numeric = (kernel.cost(chi2 + step) - kernel.cost(chi2 - step)) / (2.0 * step);
            assert!((numeric - kernel.weight(chi2)).abs() < 1e-5, "{chi2}: {numeric} {}", kernel.weight(chi2));
        }
        assert_eq!(Kernel::Square.cost(1e9), 1e9);
    }
}
