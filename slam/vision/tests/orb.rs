//! The extractor as a whole.
#![allow(clippy::unwrap_used, reason = "a failing helper fails its test")]

mod common;

use common::{collage, noise};
use slam_math::DigestWriter;
use slam_math::float::{cos, sin};
use slam_vision::{
    Features, GrayImage, Image, Kernels, OrbConfig, OrbExtractor, Part, Parts, VisionError, Workspace, hamming,
};

fn extractor() -> OrbExtractor {
    OrbExtractor::new(&OrbConfig::default()).unwrap()
}

#[test]
fn features_are_complete_ordered_and_inside() {
    let features = extractor().extract(&collage(640, 480));
    let count = features.len();
    assert!((990..=1000).contains(&count), "{count}");
    let Features { pixel, octave, angle, response, descriptor } = &features;
    assert_eq!([pixel.len(), octave.len(), angle.len(), response.len(), descriptor.len()], [count; 5]);
    assert!(octave.is_sorted());
    assert!(response.iter().all(|&score| score >= 7));
    assert!(angle.iter().all(|angle| angle.abs() <= std::f32::consts::PI));
    assert!(pixel.iter().all(|&[x, y]| (19.0..=620.0).contains(&x) && (19.0..=460.0).contains(&y)));
    for i in 1..count {
        let order = |i: usize| (octave[i], pixel[i][1], pixel[i][0]);
        assert!(order(i - 1) < order(i), "keypoints {} and {i} are out of order or equal", i - 1);
    }
    // Whole-level suppression: no two corners touch, not even at the seams of the cells.
    for i in 0..count {
        for j in i + 1..count {
            let [dx, dy] = [0, 1].map(|axis| (pixel[i][axis] - pixel[j][axis]).abs());
            assert!(octave[i] != 0 || octave[j] != 0 || dx > 1.0 || dy > 1.0, "{:?} {:?}", pixel[i], pixel[j]);
        }
    }
}

#[test]
fn kernels_and_workspace_never_change_a_feature() {
    let scalar = OrbExtractor::with_kernels(&OrbConfig::default(), Kernels::scalar()).unwrap();
    let mut workspace = Workspace::default();
    for (width, height) in [(640, 480), (333, 251), (39, 39), (40, 200), (161, 47), (640, 480)] {
        for image in [collage(width, height), noise(width, height, 5)] {
            let fresh = extractor().extract(&image);
            assert_eq!(fresh, extractor().extract_with(&image, None, &mut workspace), "{width} x {height}, workspace");
            assert_eq!(fresh, scalar.extract(&image), "{width} x {height}, kernels");
        }
    }
}

#[test]
fn features_are_the_same_bits_on_every_cpu_and_in_every_build() {
    let features = extractor().extract(&collage(640, 480));
    let mut digest = DigestWriter::default();
    for i in 0..features.len() {
        features.pixel[i].iter().for_each(|&v| digest.f32(v));
        digest.u8(features.octave[i]);
        digest.f32(features.angle[i]);
        digest.u8(features.response[i]);
        features.descriptor[i].iter().for_each(|&word| digest.u64(word));
    }
    // Changes only with the algorithm; say in the commit why.
    assert_eq!(digest.finish().to_string(), "3eca951fce5117ec661a6b36bb6f623e");
}

#[test]
fn images_without_corners_have_no_features() {
    for (width, height) in [(0, 0), (0, 7), (1, 1), (2, 3000), (37, 37), (38, 480), (640, 38), (640, 480), (41, 3)] {
        for gray in [0, 4, 255] {
            let found = extractor().extract(&Image::new(width, height, gray));
            assert!(found.is_empty(), "{} features in a flat {width} x {height} image", found.len());
        }
    }
}

#[test]
fn hostile_settings_and_sizes_do_not_panic() {
    let config = OrbConfig { features: 3, scale_factor: 2.0, levels: 16, cell_px: 1, ..OrbConfig::default() };
    let found = OrbExtractor::new(&config).unwrap().extract(&noise(123, 99, 2));
    assert!(found.len() <= 3 && !found.is_empty());
    let config = OrbConfig { features: 65_535, cell_px: 100_000, fast_threshold: 255, ..OrbConfig::default() };
    assert!(!OrbExtractor::new(&config).unwrap().extract(&noise(123, 99, 2)).is_empty());
    for (width, height) in [(39, 4000), (4000, 39)] {
        assert!(!extractor().extract(&noise(width, height, 3)).is_empty());
    }
    let error = OrbExtractor::new(&OrbConfig { levels: 17, ..OrbConfig::default() }).unwrap_err();
    assert_eq!(error, VisionError::Config { name: "levels", value: 17.0, allowed: "1 to 16" });
    assert!(Image::from_vec(usize::MAX, 2, vec![0u8; 4]).is_err());
}

#[test]
fn scales_are_powers_of_the_factor() {
    let scales = [1.0, 1.2, 1.44, 1.728, 2.0736, 2.488_32, 2.985_984, 3.583_180_8];
    for (octave, expected) in scales.into_iter().enumerate() {
        assert!((extractor().scale(octave as u8) - expected).abs() < 1e-12);
        assert!((extractor().scales()[octave] - expected).abs() < 1e-12);
    }
}

/// The image turned by `angle` about its centre, bilinear; and where a pixel of the original goes.
fn turned(image: &GrayImage, angle: f64) -> (GrayImage, impl Fn([f32; 2]) -> [f64; 2]) {
    let (center_x, center_y) = ((image.width - 1) as f64 / 2.0, (image.height - 1) as f64 / 2.0);
    let turn = move |x: f64, y: f64, angle: f64| {
        let (dx, dy) = (x - center_x, y - center_y);
        [center_x + dx * cos(angle) - dy * sin(angle), center_y + dx * sin(angle) + dy * cos(angle)]
    };
    let mut out = Image::new(image.width, image.height, 0);
    for y in 0..image.height {
        for x in 0..image.width {
            let [sx, sy] = turn(x as f64, y as f64, -angle);
            let [fx, fy] = [sx - sx.floor(), sy - sy.floor()];
            let at = |dx: usize, dy: usize| f64::from(image.get(sx as usize + dx, sy as usize + dy).unwrap_or(0));
            if sx >= 0.0 && sy >= 0.0 {
                let upper = at(0, 0) * (1.0 - fx) + at(1, 0) * fx;
                let lower = at(0, 1) * (1.0 - fx) + at(1, 1) * fx;
                out.data[y * image.width + x] = (upper * (1.0 - fy) + lower * fy).round() as u8;
            }
        }
    }
    (out, move |[x, y]: [f32; 2]| turn(f64::from(x), f64::from(y), angle))
}

#[test]
fn descriptors_survive_a_turn_of_the_image() {
    let image = collage(400, 400);
    let before = extractor().extract(&image);
    for degrees in [15.0_f64, 45.0, 90.0, 137.0, 180.0] {
        let angle = degrees.to_radians();
        let (after, moved) = turned(&image, angle);
        let after = extractor().extract(&after);
        // Pairs of the same corner, by geometry.
        let (mut pairs, mut close, mut aligned) = (0, 0, 0);
        for i in 0..before.len() {
            let [x, y] = moved(before.pixel[i]);
            let same_place = |j: &usize| {
                let [dx, dy] = [f64::from(after.pixel[*j][0]) - x, f64::from(after.pixel[*j][1]) - y];
                after.octave[*j] == before.octave[i] && dx * dx + dy * dy < 1.5
            };
            let Some(j) = (0..after.len()).find(same_place) else { continue };
            pairs += 1;
            close += usize::from(hamming(&before.descriptor[i], &after.descriptor[j]) <= 64);
            let turn = f64::from(after.angle[j] - before.angle[i]) - angle;
            aligned += usize::from(cos(turn) > cos(0.2));
        }
        eprintln!("{degrees} degrees: {pairs} pairs, {close} close, {aligned} aligned");
        assert!(pairs > 200, "{degrees} degrees: only {pairs} corners found again");
        assert!(close * 10 > pairs * 7, "{degrees} degrees: {close} of {pairs} descriptors alike");
        assert!(aligned * 10 > pairs * 8, "{degrees} degrees: {aligned} of {pairs} directions follow");
    }
}

#[test]
fn coarse_octaves_report_unbiased_pixels() {
    // Upside down, a keypoint must land exactly opposite; a bias of the position would show twice.
    let image = collage(640, 480);
    let mut flipped = image.clone();
    flipped.data.reverse();
    let (upright, flipped) = (extractor().extract(&image), extractor().extract(&flipped));
    for octave in 0..8 {
        let of_octave = |features: &Features| (0..features.len()).filter(|&i| features.octave[i] == octave).collect();
        let (ours, theirs): (Vec<usize>, Vec<usize>) = (of_octave(&upright), of_octave(&flipped));
        let (mut pairs, mut sum) = (0.0, [0.0, 0.0]);
        for i in ours {
            let distance = |&j: &usize| hamming(&upright.descriptor[i], &flipped.descriptor[j]);
            let Some(j) = theirs.iter().copied().min_by_key(distance).filter(|j| distance(j) < 40) else { continue };
            pairs += 1.0;
            for (axis, extent) in [639.0, 479.0].into_iter().enumerate() {
                sum[axis] += f64::from(upright.pixel[i][axis] + flipped.pixel[j][axis]) - extent;
            }
        }
        let bias = sum.map(|sum| sum / pairs / 2.0);
        assert!(pairs >= 30.0, "octave {octave}: only {pairs} pairs");
        // Rounding to whole pixels of the level leaves some noise; level coordinates times the scale would be off by
        // half of (scale - 1).
        let allowed = 0.1 * extractor().scale(octave);
        assert!(bias.iter().all(|bias| bias.abs() < allowed), "octave {octave}: {bias:?} pixels off");
    }
}

/// Texture of low contrast to the right of x = 400, of high contrast to the left.
fn loud_and_faint() -> GrayImage {
    let mut image = collage(640, 480);
    for (i, value) in image.data.iter_mut().enumerate() {
        if i % 640 >= 400 {
            *value = 100 + *value / 4;
        }
    }
    image
}

fn in_parts(left: Part, right: Part, floor: f64) -> Features {
    let of_pixel = move |[x, _]: [f32; 2]| if x < 400.0 { left } else { right };
    let parts = Parts { of_pixel: &of_pixel, floor };
    extractor().extract_with(&loud_and_faint(), Some(&parts), &mut Workspace::default())
}

fn right_of_400(features: &Features) -> usize {
    features.pixel.iter().filter(|pixel| pixel[0] >= 400.0).count()
}

#[test]
fn what_is_preferred_gets_keypoints_on_top_of_all_others() {
    let usual = in_parts(Part::Other, Part::Preferred, 0.0);
    assert_eq!(usual, extractor().extract(&loud_and_faint()), "without a floor parts change nothing");
    let faint = right_of_400(&usual);
    let more = in_parts(Part::Other, Part::Preferred, 0.6);
    let [before, after] = [&usual, &more].map(|f| f.len() - right_of_400(f));
    assert_eq!(before, after, "nothing is taken from the others");
    assert!(faint < 450 && (550..=620).contains(&right_of_400(&more)), "{faint} {}", right_of_400(&more));
    assert!(usual.pixel.iter().all(|pixel| more.pixel.contains(pixel)));
    let enough = in_parts(Part::Preferred, Part::Other, 0.3);
    assert_eq!(enough, usual, "where there are as many anyway, nothing is added");
}

#[test]
fn what_is_useless_gets_none() {
    let features = in_parts(Part::Other, Part::Useless, 0.5);
    assert_eq!(right_of_400(&features), 0);
    assert!(features.len() > 900, "{}", features.len());
}
