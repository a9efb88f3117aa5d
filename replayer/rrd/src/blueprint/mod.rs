//! The layout that a viewer opens with: a tree of containers and views, the time panel, and which side panels show.

mod rows;

pub(crate) use rows::rows;

/// A whole layout.
#[derive(Clone, Debug)]
pub struct Blueprint {
    /// Everything in the middle of the window.
    pub root: Node,
    /// The panel below.
    pub time: TimePanel,
    /// The list of entities on the left.
    pub entities: Panel,
    /// The inspector on the right.
    pub selection: Panel,
}

impl Blueprint {
    /// A layout with both side panels folded away and the time panel as [`TimePanel::default`] says.
    pub fn new(root: Node) -> Self {
        Self { root, time: TimePanel::default(), entities: Panel::Hidden, selection: Panel::Hidden }
    }
}

/// How much of a panel shows at first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Panel {
    /// Nothing.
    Hidden,
    /// A bar.
    Collapsed,
    /// All of it.
    Expanded,
}

/// The panel that picks the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimePanel {
    /// Timeline chosen at first.
    pub timeline: &'static str,
    /// What the viewer does by itself.
    pub play: Play,
    /// Frames a second when playing a frame timeline.
    pub fps: f64,
    /// How much of it shows.
    pub panel: Panel,
}

/// What the viewer does by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Play {
    /// It shows the beginning.
    Paused,
    /// It plays.
    Playing,
    /// It shows what came last.
    Following,
}

impl Default for TimePanel {
    fn default() -> Self {
        Self { timeline: "frame", play: Play::Paused, fps: 30.0, panel: Panel::Collapsed }
    }
}

/// A container or a view.
#[derive(Clone, Debug)]
pub enum Node {
    /// Several nodes side by side.
    Container(Container),
    /// One view.
    View(View),
}

impl From<Container> for Node {
    fn from(container: Container) -> Self {
        Self::Container(container)
    }
}

impl From<View> for Node {
    fn from(view: View) -> Self {
        Self::View(view)
    }
}

/// How a container arranges its children.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Left to right.
    Horizontal,
    /// Top to bottom.
    Vertical,
    /// One at a time.
    Tabs,
    /// Row by row, with that many columns.
    Grid(u32),
}

/// Several nodes arranged together.
#[derive(Clone, Debug)]
pub struct Container {
    /// How they are arranged.
    pub layout: Layout,
    /// Title, shown in tabs and in the list of entities.
    pub name: String,
    /// Relative sizes along the layout's direction (of the columns, for a grid): one a child (a column), or none for
    /// equal sizes.
    pub shares: Vec<f32>,
    /// What is arranged.
    pub children: Vec<Node>,
}

impl Container {
    /// A container with equal shares.
    pub fn new(layout: Layout, name: &str, children: Vec<Node>) -> Self {
        Self { layout, name: name.to_owned(), shares: Vec::new(), children }
    }

    /// Sets the relative sizes of the children.
    #[must_use]
    pub fn with_shares(mut self, shares: &[f32]) -> Self {
        self.shares = shares.to_vec();
        self
    }
}

/// Where the viewer's eye starts in a 3D view, and whether it follows something.
#[derive(Clone, Debug, PartialEq)]
pub struct Eye {
    /// Position in the view's frame, metres.
    pub position: [f32; 3],
    /// Point looked at, metres.
    pub target: [f32; 3],
    /// Direction shown upwards.
    pub up: [f32; 3],
}

/// Options of a 3D view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spatial3d {
    /// Start of the eye; by default the viewer frames the scene.
    pub eye: Option<Eye>,
    /// Whether the viewer's line grid is drawn.
    pub grid: bool,
}

/// Options of a 2D view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spatial2d {
    /// `[x_min, y_min, x_max, y_max]` shown at first, pixels; by default everything.
    pub bounds: Option<[f64; 4]>,
}

/// What a view draws, with its options.
#[derive(Clone, Debug, PartialEq)]
pub enum ViewKind {
    /// Space.
    Spatial3d(Spatial3d),
    /// Images and shapes on them.
    Spatial2d(Spatial2d),
    /// Curves over time; `y_range` fixes the vertical axis.
    TimeSeries {
        /// Lowest and highest value shown, or the data's own.
        y_range: Option<[f64; 2]>,
    },
    /// Lines of the text log.
    TextLog,
    /// A page of text.
    TextDocument,
}

/// One view.
#[derive(Clone, Debug)]
pub struct View {
    /// What it draws.
    pub kind: ViewKind,
    /// Title.
    pub name: String,
    /// Entity whose frame the view uses.
    pub origin: String,
    /// Which entities are in it, e.g. `+ $origin/**` or `- /world/camera/depth`; by default all below the origin.
    pub contents: Vec<String>,
    /// Entities that are in the view but switched off at first, for the user to switch on.
    pub hidden: Vec<String>,
}

impl View {
    /// A view of everything below `origin`.
    pub fn new(kind: ViewKind, name: &str, origin: &str) -> Self {
        let contents = vec!["+ $origin/**".to_owned()];
        Self { kind, name: name.to_owned(), origin: origin.to_owned(), contents, hidden: Vec::new() }
    }

    /// Sets which entities are in the view.
    #[must_use]
    pub fn with_contents(mut self, contents: &[&str]) -> Self {
        self.contents = contents.iter().map(|&rule| rule.to_owned()).collect();
        self
    }

    /// Sets which entities are switched off at first.
    #[must_use]
    pub fn with_hidden(mut self, entities: &[&str]) -> Self {
        self.hidden = entities.iter().map(|&entity| entity.to_owned()).collect();
        self
    }
}
