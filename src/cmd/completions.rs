//! `pslam completions`.

use crate::{Outcome, help, stdout};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pslam completions bash > ~/.local/share/bash-completion/completions/pslam
  pslam completions zsh > ~/.zfunc/_pslam        # a folder of $fpath, before compinit
  pslam completions fish > ~/.config/fish/completions/pslam.fish")]
pub struct Completions {
    /// The shell.
    shell: clap_complete::Shell,
}

impl Completions {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut help::command(), "pslam", &mut script);
        stdout::text(&String::from_utf8(script)?)?;
        Ok(Outcome::Good)
    }
}
