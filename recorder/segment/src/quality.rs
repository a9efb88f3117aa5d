//! How good labels are: panoptic quality (Kirillov et al., "Panoptic Segmentation", 2019) and what happens to people.

use crate::Mask;
use schemas::msg::Category;
use schemas::panoptic::{PERSON, VOID_CLASS, VOID_INSTANCE};
use serde::Serialize;
use std::collections::BTreeMap;

/// One class over all pictures.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct ClassQuality {
    /// Name, the same in both layers.
    pub name: String,
    /// Countable.
    pub is_thing: bool,
    /// Segments found: pairs that overlap by more than half (intersection over union).
    pub true_positives: u64,
    /// Segments that nothing in the truth matches.
    pub false_positives: u64,
    /// Segments of the truth that were not found.
    pub false_negatives: u64,
    /// Sum of the matched pairs' overlaps.
    pub iou_sum: f64,
    /// Panoptic quality 0..=1, segmentation quality times recognition quality.
    pub pq: f64,
    /// Mean overlap of the matched pairs.
    pub sq: f64,
    /// F1 score of the matching.
    pub rq: f64,
}

/// A mean over the classes that occur.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct MeanQuality {
    /// Panoptic quality.
    pub pq: f64,
    /// Segmentation quality.
    pub sq: f64,
    /// Recognition quality.
    pub rq: f64,
    /// How many classes.
    pub classes: usize,
}

/// What happens to the pixels of people, and how many frames miss one.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct PersonQuality {
    /// Pixels that are people in the truth.
    pub pixels: u64,
    /// Of those, labelled as people.
    pub as_person: u64,
    /// As other things.
    pub as_thing: u64,
    /// As stuff: what a SLAM takes to be still.
    pub as_stuff: u64,
    /// Unknown.
    pub as_void: u64,
    /// `as_person / pixels`; 1 without people.
    pub recall: f64,
    /// Part of the pixels labelled as people, void of the truth left out, that are people; 1 if there are none.
    pub precision: f64,
    /// Frames with people.
    pub frames: u64,
    /// Frames in which less than half of the people's pixels are labelled as people.
    pub missed_frames: u64,
    labelled: u64,
    right: u64,
}

/// The comparison of a layer with the truth.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Quality {
    /// Frames that both layers label.
    pub frames: u64,
    /// Part of all pixels with the same class (by name) in both, void included.
    pub pixel_agreement: f64,
    /// All classes.
    pub all: MeanQuality,
    /// Things.
    pub things: MeanQuality,
    /// Stuff.
    pub stuff: MeanQuality,
    /// People.
    pub person: PersonQuality,
    /// By name, those that occur.
    pub classes: Vec<ClassQuality>,
    /// Classes of the layer that the truth has no name for: their segments count nowhere.
    pub foreign: Vec<String>,
}

/// Adds up frame by frame.
#[derive(Debug, Clone)]
pub struct Judge {
    /// By place in the truth's table.
    classes: Vec<ClassQuality>,
    truth_place: BTreeMap<u16, usize>,
    layer_place: BTreeMap<u16, usize>,
    foreign: Vec<String>,
    person: PersonQuality,
    layer_is_thing: BTreeMap<u16, bool>,
    frames: u64,
    pixels: u64,
    agreeing: u64,
}

impl Judge {
    /// For a truth and a layer with these categories; they are matched by name.
    #[must_use]
    pub fn new(truth: &[Category], layer: &[Category]) -> Self {
        let class =
            |c: &Category| ClassQuality { name: c.name.clone(), is_thing: c.is_thing, ..ClassQuality::default() };
        let place = |name: &str| truth.iter().position(|c| c.name == name);
        let foreign = layer.iter().filter(|c| place(&c.name).is_none()).map(|c| c.name.clone()).collect();
        Self {
            classes: truth.iter().map(class).collect(),
            // A name that stands twice is one class.
            truth_place: truth.iter().filter_map(|c| Some((c.id, place(&c.name)?))).collect(),
            layer_place: layer.iter().filter_map(|c| Some((c.id, place(&c.name)?))).collect(),
            layer_is_thing: layer.iter().map(|c| (c.id, c.is_thing)).collect(),
            foreign,
            person: PersonQuality::default(),
            frames: 0,
            pixels: 0,
            agreeing: 0,
        }
    }

    /// Compares one picture's labels.
    ///
    /// # Errors
    /// Masks of different sizes, in words.
    pub fn add(&mut self, truth: &Mask, layer: &Mask) -> Result<(), String> {
        let (wanted, found) = (truth.class.len(), layer.class.len());
        if [truth.instance.len(), layer.instance.len(), found].iter().any(|count| *count != wanted) {
            return Err(format!("masks of {wanted} and {found} pixels"));
        }
        self.frames += 1;
        self.pixels += wanted as u64;
        let mut shared: BTreeMap<(u16, u16), u64> = BTreeMap::new(); // (truth, layer) segment ids
        for (&t, &l) in truth.instance.iter().zip(&layer.instance) {
            *shared.entry((t, l)).or_default() += 1;
        }
        self.match_segments(truth, layer, &shared);
        self.look_at_people(truth, layer);
        Ok(())
    }

    fn match_segments(&mut self, truth: &Mask, layer: &Mask, shared: &BTreeMap<(u16, u16), u64>) {
        let area = |pick: fn(&(u16, u16)) -> u16| {
            let mut areas: BTreeMap<u16, u64> = BTreeMap::new();
            shared.iter().for_each(|(pair, count)| *areas.entry(pick(pair)).or_default() += count);
            areas
        };
        let (truth_area, layer_area) = (area(|pair| pair.0), area(|pair| pair.1));
        let truth_class = |id: u16| self.truth_place.get(&truth.segment(id)?.category_id).copied();
        let layer_class = |id: u16| self.layer_place.get(&layer.segment(id)?.category_id).copied();
        let is_crowd = |id: u16| truth.segment(id).is_some_and(|segment| segment.is_crowd);
        let on = |pair: (u16, u16)| shared.get(&pair).copied().unwrap_or(0);
        let (mut matched_truth, mut matched_layer) = (Vec::new(), Vec::new());
        let mut hits = Vec::new();
        for (&(t, l), &both) in shared {
            let (Some(class), Some(other)) = (truth_class(t), layer_class(l)) else { continue };
            if class != other || is_crowd(t) {
                continue;
            }
            // Void of the truth is nobody's mistake.
            let union = truth_area[&t] + layer_area[&l] - both - on((VOID_INSTANCE, l));
            let iou = both as f64 / union as f64;
            if iou > 0.5 {
                hits.push((class, iou));
                matched_truth.push(t);
                matched_layer.push(l);
            }
        }
        let missed = truth_area.keys().filter(|id| !matched_truth.contains(id) && !is_crowd(**id));
        let missed: Vec<usize> = missed.filter_map(|id| truth_class(*id)).collect();
        let mut invented = Vec::new();
        for (&id, &pixels) in layer_area.iter().filter(|(id, _)| !matched_layer.contains(id)) {
            let Some(class) = layer_class(id) else { continue };
            let crowd = truth.segments.iter().filter(|s| s.is_crowd && truth_class(s.id) == Some(class));
            let excused = on((VOID_INSTANCE, id)) + crowd.map(|s| on((s.id, id))).sum::<u64>();
            if 2 * excused <= pixels {
                invented.push(class);
            }
        }
        for (class, iou) in hits {
            self.classes[class].true_positives += 1;
            self.classes[class].iou_sum += iou;
        }
        missed.into_iter().for_each(|class| self.classes[class].false_negatives += 1);
        invented.into_iter().for_each(|class| self.classes[class].false_positives += 1);
    }

    fn look_at_people(&mut self, truth: &Mask, layer: &Mask) {
        let person = self.classes.iter().position(|class| class.name == PERSON);
        let (mut people, mut found) = (0_u64, 0_u64);
        for (&t, &l) in truth.class.iter().zip(&layer.class) {
            let (own, other) = (self.truth_place.get(&t).copied(), self.layer_place.get(&l).copied());
            let void = t == VOID_CLASS && l == VOID_CLASS;
            self.agreeing += u64::from(void || own.is_some() && own == other);
            let labelled = person.is_some() && other == person;
            if labelled && t != VOID_CLASS {
                self.person.labelled += 1;
                self.person.right += u64::from(own == person);
            }
            if person.is_none() || own != person {
                continue;
            }
            people += 1;
            match self.layer_is_thing.get(&l) {
                _ if labelled => found += 1,
                Some(true) => self.person.as_thing += 1,
                Some(false) => self.person.as_stuff += 1,
                None => self.person.as_void += 1,
            }
        }
        self.person.pixels += people;
        self.person.as_person += found;
        self.person.frames += u64::from(people > 0);
        self.person.missed_frames += u64::from(2 * found < people);
    }

    /// The result so far.
    #[must_use]
    pub fn quality(&self) -> Quality {
        let part = |a: u64, b: u64| if b == 0 { 1.0 } else { a as f64 / b as f64 };
        let occurs = |c: &&ClassQuality| c.true_positives + c.false_positives + c.false_negatives > 0;
        let classes: Vec<ClassQuality> = self.classes.iter().filter(occurs).map(ClassQuality::finished).collect();
        let mut person = self.person.clone();
        person.recall = part(person.as_person, person.pixels);
        person.precision = part(person.right, person.labelled);
        Quality {
            frames: self.frames,
            pixel_agreement: part(self.agreeing, self.pixels),
            all: mean(classes.iter()),
            things: mean(classes.iter().filter(|class| class.is_thing)),
            stuff: mean(classes.iter().filter(|class| !class.is_thing)),
            person,
            classes,
            foreign: self.foreign.clone(),
        }
    }
}

impl ClassQuality {
    fn finished(&self) -> Self {
        let tp = self.true_positives as f64;
        let sq = if self.true_positives == 0 { 0.0 } else { self.iou_sum / tp };
        let rq = tp / (tp + 0.5 * (self.false_positives + self.false_negatives) as f64);
        Self { sq, rq, pq: sq * rq, ..self.clone() }
    }
}

fn mean<'c>(classes: impl Iterator<Item = &'c ClassQuality>) -> MeanQuality {
    let mut sum = MeanQuality::default();
    for class in classes {
        sum.pq += class.pq;
        sum.sq += class.sq;
        sum.rq += class.rq;
        sum.classes += 1;
    }
    let count = if sum.classes == 0 { 1.0 } else { sum.classes as f64 };
    MeanQuality { pq: sum.pq / count, sq: sum.sq / count, rq: sum.rq / count, classes: sum.classes }
}
