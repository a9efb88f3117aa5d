//! What stands in a log against what was fed.

use crate::log::for_each_sample;
use crate::plan::Plan;
use crate::planted;
use crate::sensors::Rig;
use recorder::Arrival;
use recorder::realsense::{FrameHeader, Sample};
use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

/// Fails at the first difference.
pub fn compare(log: &Path, plan: &Plan) -> Result<(), Box<dyn Error>> {
    let rig = Rig::new(plan)?;
    let (mut seen, mut pixels, mut values) = (BTreeMap::<String, Vec<u64>>::new(), 0_u64, 0_u64);
    let mut different = None;
    for_each_sample(log, &mut |kind, sample| {
        let header = header(&sample);
        seen.entry(format!("{kind:?}")).or_default().push(header.number);
        values += header.metadata.len() as u64;
        let number = header.number;
        if let Sample::Frame(frame) = &sample {
            pixels += u64::from(frame.width) * u64::from(frame.height);
        }
        let fed = planted(plan, rig.sample(plan, kind, number));
        if different.is_none() && fed.as_ref() != Some(&without_arrival(sample)) {
            different = Some(format!("{kind:?} {number} differs from what was fed"));
        }
    });
    if let Some(different) = different {
        return Err(different.into());
    }
    let mut fed = BTreeMap::<String, Vec<u64>>::new();
    rig.samples(plan, &mut |_, sample| {
        let header = header(&sample);
        fed.entry(format!("{:?}", header.stream.kind)).or_default().push(header.number);
        Ok(())
    })?;
    for (kind, numbers) in &fed {
        let found = seen.get(kind).cloned().unwrap_or_default();
        if found != *numbers {
            let missing: Vec<&u64> = numbers.iter().filter(|number| !found.contains(number)).collect();
            return Err(format!("{kind}: {} of {}, missing {missing:?}", found.len(), numbers.len()).into());
        }
    }
    let counts: Vec<String> = fed.iter().map(|(kind, numbers)| format!("{} {kind}", numbers.len())).collect();
    println!("as fed: {}; {pixels} pixels and {values} metadata values are equal", counts.join(", "));
    Ok(())
}

fn header(sample: &Sample) -> &FrameHeader {
    match sample {
        Sample::Frame(frame) => &frame.header,
        Sample::Motion(motion) => &motion.header,
        Sample::Unreadable { .. } => unreachable!("a log holds none"),
    }
}

fn without_arrival(mut sample: Sample) -> Sample {
    match &mut sample {
        Sample::Frame(frame) => frame.header.arrival = Arrival::default(),
        Sample::Motion(motion) => motion.header.arrival = Arrival::default(),
        Sample::Unreadable { .. } => {}
    }
    sample
}
