//! Vectors as arrays, for serde: `#[serde(with = "slam_math::vector")]`. The feature of nalgebra that would do it also changes
//! crates of the viewer.

use nalgebra::Vector3;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// As `[f64; 3]`.
///
/// # Errors
/// Those of the serializer.
pub fn serialize<S: Serializer>(v: &Vector3<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    <[f64; 3]>::from(*v).serialize(serializer)
}

/// From `[f64; 3]`.
///
/// # Errors
/// Those of the deserializer.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vector3<f64>, D::Error> {
    <[f64; 3]>::deserialize(deserializer).map(Vector3::from)
}

/// Vectors with a key each.
pub mod keyed {
    use super::{Deserialize, Deserializer, Serialize, Serializer, Vector3};

    /// As `[(K, [f64; 3])]`.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<K: Serialize + Copy, S: Serializer>(
        pairs: &[(K, Vector3<f64>)],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(pairs.iter().map(|(key, v)| (*key, <[f64; 3]>::from(*v))))
    }

    /// From `[(K, [f64; 3])]`.
    ///
    /// # Errors
    /// Those of the deserializer.
    pub fn deserialize<'de, K: Deserialize<'de>, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<(K, Vector3<f64>)>, D::Error> {
        let pairs: Vec<(K, [f64; 3])> = Vec::deserialize(deserializer)?;
        Ok(pairs.into_iter().map(|(key, v)| (key, Vector3::from(v))).collect())
    }
}
