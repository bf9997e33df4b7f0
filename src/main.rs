//! The command line: parse, run, tell, exit.

mod commands;
mod interrupt;
mod show;

use clap::Parser;
use commands::Exit;
use interrupt::Interrupt;
use std::process::ExitCode;
use texelwalk::cli::{Cli, Command};

fn main() -> ExitCode {
    match run(Cli::parse().command) {
        Ok(exit) => exit.into(),
        Err((exit, message)) => {
            show::error(&message);
            exit.into()
        }
    }
}

fn run(command: Command) -> Result<Exit, (Exit, String)> {
    let listen = Interrupt::listen;
    match command {
        Command::Bake(options) => commands::bake(*options, &listen()?),
        Command::Inspect(options) => listen().and_then(|_| commands::inspect(&options)),
        Command::Compare(options) => listen().and_then(|_| commands::compare(&options)),
        Command::Render(options) => commands::render(&options, &listen()?),
        Command::Check(options) => commands::check(&options, &listen()?),
        // It lets nobody interrupt it.
        #[cfg(unix)]
        Command::Place => commands::place(),
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
