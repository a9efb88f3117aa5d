//! Turns a layout into the rows of a blueprint store. Views and containers are known by UUIDs, which are counted here in
//! order of the tree, so that the same layout has the same ids (and a picture of one view can be asked for by id).

use re_sdk_types::blueprint::components::{self as bp, ContainerKind, PanelState, PlayState, RootContainer};
use re_sdk_types::blueprint::{archetypes, datatypes as bp_datatypes};
use re_sdk_types::{AsComponents, SerializedComponentBatch, components, datatypes};

use super::{Blueprint, Container, Layout, Node, Panel, Play, View, ViewKind};
use crate::RrdError;

/// Behind 3D scenes: points and thin lines read best on a plain dark ground, and versions of the viewer differ in theirs.
const BACKGROUND: [u8; 3] = [13, 15, 20];

/// One entity of the blueprint store and its components.
type Row = (String, Vec<SerializedComponentBatch>);

/// All rows of the blueprint store for `layout`.
pub fn rows(layout: &Blueprint) -> Result<Vec<Row>, RrdError> {
    let mut rows = Rows::default();
    // The viewer wants a container at the root.
    let root = match &layout.root {
        Node::Container(container) => rows.container(container)?,
        Node::View(view) => rows.container(&Container::new(Layout::Tabs, "", vec![view.clone().into()]))?,
    };
    rows.add(
        "viewport",
        &archetypes::ViewportBlueprint::new()
            .with_root_container(RootContainer(datatypes::Uuid { bytes: root.to_be_bytes() }))
            .with_auto_layout(false)
            .with_auto_views(false),
    );
    let time = &layout.time;
    rows.add(
        "time_panel",
        &archetypes::TimePanelBlueprint::new()
            .with_state(panel_state(time.panel))
            .with_timeline(time.timeline)
            .with_fps(time.fps)
            .with_play_state(match time.play {
                Play::Paused => PlayState::Paused,
                Play::Playing => PlayState::Playing,
                Play::Following => PlayState::Following,
            }),
    );
    for (entity, panel) in [("blueprint_panel", layout.entities), ("selection_panel", layout.selection)] {
        rows.add(entity, &archetypes::PanelBlueprint::new().with_state(panel_state(panel)));
    }
    Ok(rows.rows)
}

#[derive(Default)]
struct Rows {
    rows: Vec<Row>,
    last_id: u128,
}

impl Rows {
    fn add(&mut self, entity: &str, archetype: &dyn AsComponents) {
        self.rows.push((entity.to_owned(), archetype.as_serialized_batches()));
    }

    /// Next UUID: the version and variant bits of a random one, and the count.
    fn next_id(&mut self) -> u128 {
        self.last_id += 1;
        0x0000_0000_0000_4000_8000_0000_0000_0000 | self.last_id
    }

    fn node(&mut self, node: &Node) -> Result<String, RrdError> {
        Ok(match node {
            Node::Container(container) => format!("container/{}", uuid_text(self.container(container)?)),
            Node::View(view) => format!("view/{}", uuid_text(self.view(view))),
        })
    }

    fn container(&mut self, container: &Container) -> Result<u128, RrdError> {
        let Container { layout, name, shares, children } = container;
        let expected = if let Layout::Grid(columns) = layout { *columns as usize } else { children.len() };
        if !shares.is_empty() && shares.len() != expected {
            return Err(RrdError::Shares { name: name.clone(), children: expected, shares: shares.len() });
        }
        let id = self.next_id();
        let contents = children.iter().map(|child| self.node(child)).collect::<Result<Vec<_>, _>>()?;
        let kind = match layout {
            Layout::Horizontal => ContainerKind::Horizontal,
            Layout::Vertical => ContainerKind::Vertical,
            Layout::Tabs => ContainerKind::Tabs,
            Layout::Grid(_) => ContainerKind::Grid,
        };
        let mut row = archetypes::ContainerBlueprint::new(kind).with_contents(contents.iter().map(String::as_str));
        if !name.is_empty() {
            row = row.with_display_name(name.as_str());
        }
        row = match layout {
            Layout::Vertical => row.with_row_shares(shares.iter().copied()),
            _ => row.with_col_shares(shares.iter().copied()),
        };
        if let Layout::Grid(columns) = layout {
            row = row.with_grid_columns(*columns);
        }
        if let (Layout::Tabs, Some(first)) = (layout, contents.first()) {
            row = row.with_active_tab(first.as_str());
        }
        self.add(&format!("container/{}", uuid_text(id)), &row);
        Ok(id)
    }

    fn view(&mut self, view: &View) -> u128 {
        let id = self.next_id();
        let path = format!("view/{}", uuid_text(id));
        let class = match view.kind {
            ViewKind::Spatial3d(_) => "3D",
            ViewKind::Spatial2d(_) => "2D",
            ViewKind::TimeSeries { .. } => "TimeSeries",
            ViewKind::TextLog => "TextLog",
            ViewKind::TextDocument => "TextDocument",
        };
        self.add(
            &path,
            &archetypes::ViewBlueprint::new(class)
                .with_display_name(view.name.as_str())
                .with_space_origin(view.origin.as_str()),
        );
        self.add(
            &format!("{path}/ViewContents"),
            &archetypes::ViewContents::new(view.contents.iter().map(String::as_str)),
        );
        for entity in &view.hidden {
            let entity = entity.trim_start_matches('/');
            self.add(
                &format!("{path}/ViewContents/overrides/{entity}/visualizers"),
                &archetypes::EntityBehavior::new().with_visible(false),
            );
        }
        self.options(&path, &view.kind);
        id
    }

    fn options(&mut self, path: &str, kind: &ViewKind) {
        match kind {
            ViewKind::Spatial3d(options) => {
                let background = archetypes::Background::new(bp::BackgroundKind::SolidColor)
                    .with_color(datatypes::Rgba32::from_rgb(BACKGROUND[0], BACKGROUND[1], BACKGROUND[2]));
                self.add(&format!("{path}/Background"), &background);
                self.add(&format!("{path}/LineGrid3D"), &archetypes::LineGrid3D::new().with_visible(options.grid));
                if let Some(eye) = &options.eye {
                    let controls = archetypes::EyeControls3D::new()
                        .with_kind(bp::Eye3DKind::Orbital)
                        .with_position(eye.position)
                        .with_look_target(eye.target)
                        .with_eye_up(eye.up);
                    self.add(&format!("{path}/EyeControls3D"), &controls);
                }
            }
            ViewKind::Spatial2d(options) => {
                if let Some([x_min, y_min, x_max, y_max]) = options.bounds {
                    let range = datatypes::Range2D { x_range: [x_min, x_max].into(), y_range: [y_min, y_max].into() };
                    self.add(&format!("{path}/VisualBounds2D"), &archetypes::VisualBounds2D::new(range));
                }
            }
            ViewKind::TimeSeries { y_range } => {
                let legend = archetypes::PlotLegend::new().with_corner(bp::Corner2D::LeftTop);
                self.add(&format!("{path}/PlotLegend"), &legend);
                if let Some([low, high]) = y_range {
                    let axis = archetypes::ScalarAxis::new().with_range(components::Range1D([*low, *high].into()));
                    self.add(&format!("{path}/ScalarAxis"), &axis);
                }
            }
            ViewKind::TextLog => self.add(&format!("{path}/TextLogColumns"), &log_columns()),
            ViewKind::TextDocument => {}
        }
    }
}

/// Frame, level and text: entity paths and nanoseconds only take room.
fn log_columns() -> archetypes::TextLogColumns {
    use bp_datatypes::{TextLogColumn, TextLogColumnKind, TimelineColumn};
    archetypes::TextLogColumns::new()
        .with_timeline_columns([TimelineColumn { visible: true.into(), timeline: "frame".into() }])
        .with_text_log_columns(
            [TextLogColumnKind::LogLevel, TextLogColumnKind::Body]
                .map(|kind| TextLogColumn { visible: true.into(), kind }),
        )
}

fn panel_state(panel: Panel) -> PanelState {
    match panel {
        Panel::Hidden => PanelState::Hidden,
        Panel::Collapsed => PanelState::Collapsed,
        Panel::Expanded => PanelState::Expanded,
    }
}

/// The usual 8-4-4-4-12 form.
fn uuid_text(id: u128) -> String {
    let hex = format!("{id:032x}");
    [&hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..]].join("-")
}
