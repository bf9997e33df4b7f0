//! The command line: parse, run, tell, exit.

mod commands;
mod show;

use clap::Parser;
use commands::Exit;
use std::process::ExitCode;
use texelwalk::cli::{Cli, Command};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match cli.command {
        Command::Bake(options) => commands::bake(*options),
        Command::Inspect(options) => commands::inspect(&options),
        Command::Compare(options) => commands::compare(&options),
        Command::Render(options) => commands::render(&options),
        Command::Check(options) => commands::check(&options),
    };
    match result {
        Ok(exit) => exit.into(),
        Err((exit, message)) => {
            show::error(&message);
            exit.into()
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
