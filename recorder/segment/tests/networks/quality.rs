//! Panoptic quality by hand.

use schemas::msg::{Category, Segment};
use segment::Mask;
use segment::quality::Judge;

fn categories() -> Vec<Category> {
    let row = |id, name: &str, is_thing| Category { id, name: name.to_owned(), is_thing };
    vec![row(1, "person", true), row(2, "cup", true), row(9, "wall", false)]
}

/// A mask of ten pixels from segment ids and the categories of segments 1, 2, ...
fn mask(instance: [u16; 10], categories: &[u16]) -> Mask {
    let segment = |(at, category_id): (usize, &u16)| Segment {
        id: at as u16 + 1,
        category_id: *category_id,
        ..Segment::default()
    };
    let class = instance.iter().map(|id| usize::from(*id).checked_sub(1).map_or(0, |at| categories[at])).collect();
    Mask { class, instance: instance.to_vec(), segments: categories.iter().enumerate().map(segment).collect() }
}

#[test]
fn matches_are_counted_as_in_the_paper() {
    let mut judge = Judge::new(&categories(), &categories());
    // Person of four pixels found with three of them and one of the wall: 3 / 5. Wall of four: three found, and the void
    // pixel that it takes is nobody's mistake: 3 / 4. The cup is void in the truth: excused.
    let truth = mask([1, 1, 1, 1, 2, 2, 2, 2, 0, 0], &[1, 9]);
    let layer = mask([0, 1, 1, 1, 1, 2, 2, 2, 2, 3], &[1, 9, 2]);
    judge.add(&truth, &layer).unwrap();
    let quality = judge.quality();
    let class = |name: &str| quality.classes.iter().find(|class| class.name == name).cloned();
    assert!((class("person").unwrap().pq - 0.6).abs() < 1e-12);
    assert!((class("wall").unwrap().pq - 0.75).abs() < 1e-12);
    assert_eq!(class("cup"), None, "neither found nor missed nor invented");
    assert!((quality.all.pq - 0.675).abs() < 1e-12);
    assert_eq!((quality.person.pixels, quality.person.as_person, quality.person.as_void), (4, 3, 1));
    assert_eq!(quality.person.precision, 0.75);
    assert_eq!(quality.pixel_agreement, 0.6);

    // A second picture: an invented cup on the wall, and a person whom nobody found.
    let truth = mask([1, 1, 1, 2, 2, 2, 2, 2, 2, 2], &[1, 9]);
    let layer = mask([2, 2, 2, 2, 2, 2, 2, 2, 1, 1], &[2, 9]);
    judge.add(&truth, &layer).unwrap();
    let quality = judge.quality();
    let class = |name: &str| quality.classes.iter().find(|class| class.name == name).cloned().unwrap();
    assert_eq!((class("cup").false_positives, class("cup").pq), (1, 0.0));
    let person = class("person");
    assert_eq!((person.true_positives, person.false_negatives, person.false_positives), (1, 1, 0));
    assert!(
        (person.pq - 0.6 / 1.5).abs() < 1e-12,
        "an intersection over union of 5 / 10 is no match for the wall either"
    );
    assert_eq!((quality.person.frames, quality.person.missed_frames, quality.person.as_stuff), (2, 1, 3));
}

#[test]
fn names_decide_and_strangers_are_named() {
    let layer = [
        Category { id: 40, name: "wall".to_owned(), is_thing: false },
        Category { id: 1, name: "ufo".to_owned(), is_thing: true },
    ];
    let mut judge = Judge::new(&categories(), &layer);
    judge.add(&mask([1; 10], &[9]), &mask([1, 1, 1, 1, 1, 1, 1, 1, 1, 2], &[40, 1])).unwrap();
    let quality = judge.quality();
    assert_eq!(quality.foreign, ["ufo"]);
    assert!((quality.stuff.pq - 0.9).abs() < 1e-12);
    assert!(judge.add(&mask([1; 10], &[9]), &Mask { class: vec![], instance: vec![], segments: vec![] }).is_err());
}
