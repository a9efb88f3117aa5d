//! Vocabulary of binary words: training, text format, index.
#![allow(clippy::unwrap_used, reason = "a failing helper fails its test")]

mod common;

use std::fmt::Write as _;
use std::sync::{Arc, LazyLock};

use common::descriptors;
use proptest::prelude::*;
use slam_math::Rng;
use slam_vision::{
    Descriptor, LineProblem, Vocabulary, VocabularyError, VocabularyOptions, WordIndex, bag_score, hamming,
};

/// Pictures of `count` descriptors, each near one of 60 corners of the world: a tenth of its bits differ.
fn pictures(pictures: usize, count: usize, seed: u64) -> Vec<Vec<Descriptor>> {
    let corners = descriptors(60, 1000);
    let mut rng = Rng::at(seed, 1, 0, 0);
    let mut seen = || {
        let mut descriptor = corners[rng.below(corners.len())];
        for _ in 0..26 {
            let bit = rng.below(256);
            descriptor[bit / 64] ^= 1 << (bit % 64);
        }
        descriptor
    };
    (0..pictures).map(|_| (0..count).map(|_| seen()).collect()).collect()
}

fn trained(branching: u32, depth: u32, seed: u64) -> Vocabulary {
    Vocabulary::train(&pictures(20, 30, seed), &VocabularyOptions { branching, depth, seed }).unwrap()
}

fn text_of(vocabulary: &Vocabulary) -> String {
    vocabulary.to_text()
}

fn node(parent: u32, is_leaf: u32, descriptor: &Descriptor, weight: &str) -> String {
    let mut line = format!("{parent} {is_leaf} ");
    for byte in descriptor.iter().flat_map(|word| word.to_le_bytes()) {
        write!(line, "{byte} ").unwrap();
    }
    line + weight + "\n"
}

/// A valid file that is damaged in the tests below.
static TEXT: LazyLock<String> = LazyLock::new(|| text_of(&trained(3, 3, 5)));

fn numbered(descriptors: &[Descriptor]) -> Vec<(u32, Descriptor)> {
    (0..).zip(descriptors.iter().copied()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn text_gives_back_what_was_written(branching in 2u32..8, depth in 1u32..5, seed in 0u64..1000) {
        let vocabulary = trained(branching, depth, seed);
        prop_assert_eq!(&vocabulary, &trained(branching, depth, seed));
        prop_assert!(vocabulary.len() <= branching.pow(depth) as usize);
        let text = text_of(&vocabulary);
        prop_assert_eq!(&Vocabulary::parse(text.as_bytes()).unwrap(), &vocabulary);
        let windows = text.replace(" \n", "\n").replace('\n', " \r\n") + "\r\n \n";
        prop_assert_eq!(&Vocabulary::parse(windows.as_bytes()).unwrap(), &vocabulary);
    }

    #[test]
    fn in_a_flat_tree_the_word_is_the_nearest_leaf(leaves in 1usize..20, seed in 0u64..1000) {
        // Few bits, so that distances are often equal.
        let few = |list: Vec<Descriptor>| list.into_iter().map(|d| [d[0] & 7, 0, 0, d[3] & 3]).collect::<Vec<_>>();
        let words = few(descriptors(leaves, seed));
        let nodes: String = words.iter().map(|d| node(0, 1, d, "1")).collect();
        let vocabulary = Vocabulary::parse(format!("20 1 0 0\n{nodes}").as_bytes()).unwrap();
        for query in few(descriptors(50, seed + 5000)) {
            let nearest = (0..leaves).min_by_key(|&i| (hamming(&query, &words[i]), i)).unwrap();
            prop_assert_eq!(vocabulary.word(&query), nearest as u32);
        }
    }

    #[test]
    fn damaged_text_never_panics(at in any::<prop::sample::Index>(), byte in any::<u8>(), cut in any::<bool>()) {
        let mut bytes = TEXT.clone().into_bytes();
        let at = at.index(bytes.len());
        bytes[at] = byte;
        bytes.truncate(if cut { at } else { bytes.len() });
        if let Ok(vocabulary) = Vocabulary::parse(&bytes[..]) {
            let bag = vocabulary.bag(&descriptors(50, 3));
            prop_assert!(bag.iter().all(|(word, share)| (*word as usize) < vocabulary.len() && share.is_finite()));
        }
    }

    #[test]
    fn any_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), numbers in "[0-9 .e\n-]{0,300}") {
        prop_assert!(Vocabulary::parse(&bytes[..]).is_err());
        prop_assert!(Vocabulary::parse(numbers.as_bytes()).is_err());
    }

    #[test]
    fn the_index_gives_the_score_of_the_bags(seed in 0u64..1000) {
        let vocabulary = Arc::new(trained(4, 3, seed));
        let stored = pictures(12, 40, seed + 1);
        let (mut direct, mut detour) = (WordIndex::new(vocabulary.clone()), WordIndex::new(vocabulary.clone()));
        for id in (0..12).rev() {
            detour.add(id, &numbered(&stored[(id as usize + 5) % 12]));
        }
        for (id, picture) in (0..).zip(&stored) {
            direct.add(id, &numbered(picture));
            detour.add(id, &numbered(picture));
        }
        let query = &pictures(1, 40, seed + 2)[0];
        let found = direct.query(query, usize::MAX, |_, _| true);
        prop_assert_eq!(&found, &detour.query(query, usize::MAX, |_, _| true));
        prop_assert!(found.windows(2).all(|w| w[0].1 > w[1].1 || (w[0].1 == w[1].1 && w[0].0 < w[1].0)));
        for (id, score) in found {
            let expected = bag_score(&vocabulary.bag(query), &vocabulary.bag(&stored[id as usize]));
            prop_assert!((score - expected).abs() < 1e-12 && score <= 1.0 + 1e-12, "{} {}", score, expected);
        }
    }
}

#[test]
fn training_finds_the_corners_of_the_world() {
    let options = VocabularyOptions { branching: 8, depth: 3, seed: 1 };
    let vocabulary = Vocabulary::train(&pictures(50, 60, 1), &options).unwrap();
    let corners = descriptors(60, 1000);
    let again = pictures(1, 500, 2).remove(0);
    // The corner of a sight is the nearest one; how often do sights of one corner share its word?
    let corner = |d: &Descriptor| (0..60).min_by_key(|&i| hamming(d, &corners[i])).unwrap();
    let shared = again.iter().filter(|d| vocabulary.word(d) == vocabulary.word(&corners[corner(d)])).count();
    assert!(shared > 300, "{shared} of 500");
}

#[test]
fn training_refuses_what_trains_nothing() {
    let train = |pictures: &[Vec<Descriptor>], branching, depth| {
        Vocabulary::train(pictures, &VocabularyOptions { branching, depth, seed: 1 })
    };
    assert!(matches!(train(&[], 10, 4), Err(VocabularyError::NothingToTrainOn { pictures: 0 })));
    assert!(matches!(train(&[vec![], vec![]], 10, 4), Err(VocabularyError::NothingToTrainOn { pictures: 2 })));
    for (branching, depth) in [(1, 4), (21, 4), (10, 0), (10, 11)] {
        assert!(matches!(train(&[vec![[0; 4]]], branching, depth), Err(VocabularyError::Shape { .. })));
    }
    let one = train(&[vec![[7; 4]; 5], vec![[7; 4]; 3], vec![]], 10, 4).unwrap();
    let (descriptor, weight) = one.entry(0).unwrap();
    assert_eq!((one.len(), descriptor, one.entry(1)), (1, &[7; 4], None));
    assert!((weight - slam_math::float::ln(1.5)).abs() < 1e-15);
    assert_eq!(one.bag(&[[0; 4], [9; 4]]), [(0, 1.0)]);
}

#[test]
fn weights_and_scores_are_those_worked_out_by_hand() {
    let [a, b, c] = [[0; 4], [u64::MAX, 0, 0, 0], [u64::MAX, u64::MAX, 0, 0]];
    let nodes = [node(0, 0, &a, "0"), node(0, 1, &c, "3"), node(1, 1, &a, "1"), node(1, 1, &b, "2")].concat();
    let vocabulary = Vocabulary::parse(format!("10 2 0 0\n{nodes}").as_bytes()).unwrap();
    // Words in the order of the leaves' lines: c, a, b; b is as near to the inner node as to c, and the first wins.
    assert_eq!([c, a, b].map(|d| vocabulary.word(&d)), [0, 1, 2]);
    let (first, second) = (vocabulary.bag(&[a, c, a]), vocabulary.bag(&[b, c, b, b]));
    assert_eq!(first, [(0, 0.6), (1, 0.4)]);
    assert_eq!(second, [(0, 3.0 / 9.0), (2, 6.0 / 9.0)]);
    assert_eq!(bag_score(&first, &second), 3.0 / 9.0);
    assert_eq!(bag_score(&first, &first), 1.0);
    assert_eq!(vocabulary.bag(&[]), []);
}

#[test]
fn a_bad_line_is_named() {
    let zero = [0; 4];
    let leaf = |weight: &str| node(0, 1, &zero, weight);
    let problem = |text: String| match Vocabulary::parse(text.as_bytes()).unwrap_err() {
        VocabularyError::Line { line, problem } => (line, problem),
        other => panic!("{other}"),
    };
    let of = |lines: &[String]| problem(format!("2 2 0 0\n{}", lines.concat()));
    assert_eq!(problem(String::new()), (1, LineProblem::Fields { expected: 4, found: 0 }));
    assert_eq!(problem("10 6 0".into()), (1, LineProblem::Fields { expected: 4, found: 3 }));
    for found in [[4_000_000_000, 6, 0, 0], [10, 11, 0, 0], [10, 6, 1, 0], [10, 6, 0, 3], [1, 6, 0, 0]] {
        let [k, l, scoring, weighting] = found;
        assert_eq!(problem(format!("{k} {l} {scoring} {weighting}\n")), (1, LineProblem::Header { found }));
    }
    assert_eq!(of(&[]), (1, LineProblem::Childless { node: 0 }));
    assert_eq!(of(&[leaf("1 1")]), (2, LineProblem::Fields { expected: 35, found: 36 }));
    assert_eq!(of(&[leaf("1"), "\n".into(), leaf("1")]), (3, LineProblem::Fields { expected: 35, found: 0 }));
    for weight in ["NaN", "inf", "-1", "1e7", "x"] {
        let expected = LineProblem::Number { field: 35, found: weight.into(), expected: "a weight, 0 to 1000000" };
        assert_eq!(of(&[leaf("1"), leaf(weight)]), (3, expected));
    }
    let byte = LineProblem::Number { field: 3, found: "256".into(), expected: "a byte, 0 to 255" };
    assert_eq!(of(&[leaf("1").replacen("0 1 0", "0 1 256", 1)]), (2, byte));
    let flag = LineProblem::Number { field: 2, found: "2".into(), expected: "0 or 1" };
    assert_eq!(of(&[node(0, 2, &zero, "1")]), (2, flag));
    assert_eq!(of(&[node(1, 1, &zero, "1")]), (2, LineProblem::NoParent { node: 1, parent: 1 }));
    let huge = LineProblem::NoParent { node: 1, parent: u32::MAX };
    assert_eq!(of(&[node(u32::MAX, 1, &zero, "1")]), (2, huge));
    assert_eq!(of(&[leaf("1"), node(1, 1, &zero, "1")]), (3, LineProblem::LeafParent { node: 2, parent: 1 }));
    assert_eq!(of(&[leaf("1"), leaf("1"), leaf("1")]), (4, LineProblem::Siblings { parent: 0, branching: 2 }));
    let inner = |parent| node(parent, 0, &zero, "0");
    assert_eq!(of(&[inner(0), inner(1), inner(2)]), (4, LineProblem::Deep { node: 3, depth: 2 }));
    assert_eq!(of(&[leaf("1"), inner(0)]), (3, LineProblem::Childless { node: 2 }));
    assert_eq!(problem(format!("2 2 0 0{}", " ".repeat(5000))), (1, LineProblem::Long));
    assert_eq!(of(&["7".repeat(5000)]), (2, LineProblem::Long));
}

#[test]
fn the_word_index_forgets_and_asks_who_may_vote() {
    let vocabulary = Arc::new(trained(6, 3, 1));
    let mut index = WordIndex::new(vocabulary);
    let stored = pictures(10, 100, 3);
    for (id, picture) in (0..).zip(&stored) {
        index.add(id, &numbered(picture));
    }
    let best = |index: &WordIndex, query| index.query(query, 3, |_, _| true);
    assert_eq!((best(&index, &stored[4])[0].0, best(&index, &stored[4]).len()), (4, 3));
    let all = index.query(&stored[4], 1, |_, _| true)[0].1;
    let half = index.query(&stored[4], 10, |id, keypoint| id == 4 && keypoint % 2 == 1);
    assert!(half.len() == 1 && half[0].1 > 0.3 * all && half[0].1 < 0.7 * all, "{half:?} of {all}");
    assert_eq!(index.query(&stored[4], 10, |_, _| false), []);
    assert!(index.remove(4) && !index.remove(4) && index.len() == 9);
    assert!(best(&index, &stored[4]).iter().all(|(id, _)| *id != 4));
    (0..10).for_each(|id| _ = index.remove(id));
    assert!(index.is_empty() && best(&index, &stored[0]).is_empty());
    index.add(1, &[]);
    assert!(best(&index, &stored[0]).is_empty() && best(&index, &[]).is_empty());
}
