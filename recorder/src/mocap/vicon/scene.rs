//! What the packets so far add up to, and a frame made from it.

use super::client::Segments;
use super::object::{self, DYNAMIC, STATIC, id};
use super::packet::{Block, Packet, PacketError};
use crate::mocap::convert::{self, Axis};
use crate::mocap::wire::Wire;
use crate::mocap::{LatencySample, MocapBody, MocapFrame, MocapMarker};
use schemas::msg::MocapTimecode;
use slam_math::Se3;
use std::collections::{BTreeMap, BTreeSet};

/// Blocks by object id.
type Blocks = BTreeMap<u32, Vec<Block>>;

/// The objects that hold at the moment. A packet repeats only what changed; the rest is carried over by the protocol's
/// rules (see [`Scene::take`]).
#[derive(Debug, Default)]
pub struct Scene {
    statics: Blocks,
    dynamics: Blocks,
}

impl Scene {
    /// Takes a packet in; true if it has a new frame.
    ///
    /// Static objects in a packet replace all static objects before, except for those that the packet lists as unchanged,
    /// which stay; without any static object all stay. The same for dynamic ones.
    ///
    /// # Errors
    /// A list of contents that is too short.
    pub fn take(&mut self, packet: Packet) -> Result<bool, PacketError> {
        let contents: object::Contents = packet.find(id::CONTENTS)?.unwrap_or_default();
        let (mut statics, mut dynamics) = (Blocks::new(), Blocks::new());
        for block in packet.blocks {
            if STATIC.contains(&block.id) {
                statics.entry(block.id).or_default().push(block);
            } else if DYNAMIC.contains(&block.id) {
                dynamics.entry(block.id).or_default().push(block);
            }
        }
        let is_frame = dynamics.contains_key(&id::FRAME_INFO);
        carry_over(&mut self.statics, statics, &contents.unchanged);
        carry_over(&mut self.dynamics, dynamics, &contents.unchanged);
        Ok(is_frame)
    }

    fn all<T: Wire>(&self, id: u32) -> Result<Vec<T>, PacketError> {
        let blocks = if STATIC.contains(&id) { &self.statics } else { &self.dynamics };
        blocks.get(&id).into_iter().flatten().map(Block::decode).collect()
    }

    fn one<T: Wire>(&self, id: u32) -> Result<Option<T>, PacketError> {
        Ok(self.all(id)?.into_iter().next())
    }

    /// The subjects that the server knows.
    ///
    /// # Errors
    /// An object is shorter than it should be.
    pub fn subjects(&self) -> Result<Vec<object::SubjectInfo>, PacketError> {
        self.all(id::SUBJECT_INFO)
    }

    /// The frame, without its arrival. `segments` says which poses to take; an empty list of names means all subjects.
    ///
    /// # Errors
    /// An object is shorter than it should be.
    pub fn frame(&self, segments: Segments, names: &[String]) -> Result<MocapFrame, PacketError> {
        let axis = match self.one::<object::ApplicationInfo>(id::APPLICATION_INFO)? {
            Some(application) if application.axis_orientation == 1 => Axis::YUp,
            _ => Axis::ZUp,
        };
        let mut subjects = self.subjects()?;
        subjects.retain(|subject| names.is_empty() || names.contains(&subject.name));
        let latency: Option<object::LatencyInfo> = self.one(id::LATENCY_INFO)?;
        let samples = latency.unwrap_or_default().samples.into_iter();
        Ok(MocapFrame {
            number: self.one::<object::FrameInfo>(id::FRAME_INFO)?.map(|info| u64::from(info.frame_id) + 1),
            hardware_frame: self.one::<object::HardwareFrameInfo>(id::HARDWARE_FRAME_INFO)?.map(|i| i.frame_id),
            rate_hz: self.rate_hz()?,
            latency: samples.map(|sample| LatencySample { name: sample.name, seconds: sample.seconds }).collect(),
            timecode: self.timecode()?,
            bodies: self.bodies(&subjects, segments, axis)?,
            markers: self.markers(&subjects, names.is_empty(), axis)?,
            ..MocapFrame::default()
        })
    }

    fn rate_hz(&self) -> Result<Option<f64>, PacketError> {
        let info: Option<object::StreamInfo> = self.one(id::STREAM_INFO)?;
        let ticks = info.map(|info| info.frame_period_ticks).filter(|ticks| *ticks > 0);
        Ok(ticks.map(|ticks| object::TICKS_PER_SECOND / ticks as f64))
    }

    fn timecode(&self) -> Result<Option<MocapTimecode>, PacketError> {
        let code: Option<object::Timecode> = self.one(id::TIMECODE)?;
        Ok(code.map(|code| {
            let [hours, minutes, seconds, frames] = code.hmsf;
            MocapTimecode {
                hours,
                minutes,
                seconds,
                frames,
                subframes: code.subframes,
                subframes_per_frame: code.subframes_per_frame,
                standard: code.standard,
                user_bits: code.user_bits,
                field_flag: code.field_flag,
            }
        }))
    }

    fn bodies(
        &self,
        subjects: &[object::SubjectInfo],
        segments: Segments,
        axis: Axis,
    ) -> Result<Vec<MocapBody>, PacketError> {
        let poses = self.poses(segments)?;
        let quality: Vec<object::ObjectQuality> = self.all(id::OBJECT_QUALITY)?;
        let health: Vec<object::SubjectHealth> = self.all(id::SUBJECT_HEALTH)?;
        let mut bodies = Vec::new();
        for subject in subjects {
            let quality = quality.iter().find(|q| q.subject == subject.subject);
            let health = health.iter().find(|h| h.subject == subject.subject);
            for segment in &subject.segments {
                let parent = subject.segments.iter().find(|other| other.segment == segment.parent);
                let pose = match segments {
                    Segments::Global => poses.get(&(subject.subject, segment.segment)).copied(),
                    Segments::Local | Segments::Lightweight => chained(subject, segment.segment, &poses),
                };
                bodies.push(MocapBody {
                    subject: subject.name.clone(),
                    segment: segment.name.clone(),
                    parent: parent.map(|parent| parent.name.clone()).unwrap_or_default(),
                    suspect: matches!(pose, Some(None)),
                    world_from_segment: pose.flatten().map(|pose| axis.pose_to_z_up(&pose)),
                    quality: quality.map(|q| q.quality),
                    health: health.map(|h| h.health),
                    marker_error_m: health.map(|h| h.marker_error_mm / convert::MM_PER_M),
                });
            }
        }
        Ok(bodies)
    }

    /// By subject and segment: what was sent, `None` where it is no rigid transform.
    fn poses(&self, segments: Segments) -> Result<BTreeMap<(u32, u32), Option<Se3>>, PacketError> {
        let mut poses = BTreeMap::new();
        if segments == Segments::Lightweight {
            for subject in self.all::<object::LightweightSegments>(id::LIGHTWEIGHT_SEGMENTS)? {
                for pose in &subject.poses {
                    let (turn, shift) = (pose.rotation_vector.map(f64::from), pose.translation_mm.map(f64::from));
                    let key = (subject.subject, pose.segment);
                    poses.insert(key, convert::from_rotation_vector(turn, shift));
                }
            }
        } else {
            let id = if segments == Segments::Local { id::LOCAL_SEGMENTS } else { id::GLOBAL_SEGMENTS };
            for subject in self.all::<object::Segments>(id)? {
                for pose in &subject.poses {
                    let key = (subject.subject, pose.segment);
                    poses.insert(key, convert::from_matrix(pose.rotation, pose.translation_mm));
                }
            }
        }
        Ok(poses)
    }

    /// Labelled markers of these subjects; the unlabelled ones too if `unlabelled`.
    fn markers(
        &self,
        subjects: &[object::SubjectInfo],
        unlabelled: bool,
        axis: Axis,
    ) -> Result<Vec<MocapMarker>, PacketError> {
        let marker = |recon: &object::UnlabeledRecon, subject: &str, name: &str| MocapMarker {
            subject: subject.to_owned(),
            name: name.to_owned(),
            position_m: axis.point_to_z_up(recon.position_mm.map(|mm| mm / convert::MM_PER_M)),
            radius_m: recon.radius_mm / convert::MM_PER_M,
            trajectory_id: recon.trajectory,
        };
        let mut markers = Vec::new();
        for recon in self.all::<object::LabeledRecons>(id::LABELED_RECONS)?.iter().flat_map(|r| &r.recons) {
            let Some(subject) = subjects.iter().find(|subject| subject.subject == recon.subject) else { continue };
            let name = subject.markers.iter().find(|m| m.marker == recon.marker).map_or("", |m| &m.name);
            markers.push(marker(&recon.recon, &subject.name, name));
        }
        if unlabelled {
            let recons = self.all::<object::UnlabeledRecons>(id::UNLABELED_RECONS)?;
            markers.extend(recons.iter().flat_map(|r| &r.recons).map(|recon| marker(recon, "", "")));
        }
        Ok(markers)
    }
}

fn carry_over(old: &mut Blocks, mut new: Blocks, unchanged: &BTreeSet<u32>) {
    if new.is_empty() {
        return;
    }
    for (id, blocks) in std::mem::take(old) {
        if unchanged.contains(&id) {
            new.entry(id).or_insert(blocks);
        }
    }
    *old = new;
}

/// The pose of a segment in the world from poses in the parents; `None` as soon as one of the chain is not seen.
fn chained(
    subject: &object::SubjectInfo,
    segment: u32,
    poses: &BTreeMap<(u32, u32), Option<Se3>>,
) -> Option<Option<Se3>> {
    let mut world_from_segment = Se3::identity();
    let mut at = segment;
    // No chain is longer than there are segments, unless it is a circle.
    for _ in 0..subject.segments.len() {
        let Some(pose) = poses.get(&(subject.subject, at))? else { return Some(None) };
        world_from_segment = *pose * world_from_segment;
        at = subject.segments.iter().find(|other| other.segment == at)?.parent;
        if at == 0 {
            return Some(Some(world_from_segment));
        }
    }
    None
}
