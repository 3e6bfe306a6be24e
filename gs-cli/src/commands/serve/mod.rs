//! `gs serve`: the page, and the scenes and runs of a folder, for browsers of this machine.

mod answer;
mod http;
mod listing;

use std::{
    net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener},
    path::PathBuf,
};

use clap::Args;

use self::answer::Site;
use crate::{failure::Failure, files::page_files, terminal::output};

const AFTER_HELP: &str = "\
Open the address that is printed. Over ssh, forward the port: ssh -L 7860:localhost:7860 HOST.

Nothing but files of the folder can be read, nothing can be written, and other sites that are open \
in the browser have no access. With --host 0.0.0.0, everyone in the network can read the folder.";

/// The flags of `gs serve`.
#[derive(Debug, Clone, Args)]
#[command(after_help = format!("{AFTER_HELP}\n\n{}", page_files::HELP))]
pub(crate) struct ServeArgs {
    /// The folder with scenes, and outputs of gs fit and gs train, also of those that are going on
    #[arg(default_value = ".")]
    folder: PathBuf,
    /// The address of this machine to listen at
    #[arg(long, value_name = "IP", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    host: IpAddr,
    /// The port to listen at; 0 for any that is free
    #[arg(long, default_value_t = 7860)]
    port: u16,
}

/// Serves until the program is stopped.
pub(crate) fn run(args: &ServeArgs) -> Result<(), Failure> {
    let page = page_files::folder()?;
    let folder = args.folder.canonicalize().map_err(|error| Failure::usage(error).at(args.folder.display()))?;
    if !folder.is_dir() {
        return Err(Failure::usage("is no folder").at(args.folder.display()).hint("name the folder of the scene"));
    }
    let address = SocketAddr::new(args.host, args.port);
    let busy = |error| Failure::failed(error).at(address).hint("--port names another port");
    let listener = TcpListener::bind(address).map_err(busy)?;
    let bound = listener.local_addr().map_err(Failure::failed)?;
    output::result(format_args!("http://{bound}/ shows {}; Ctrl-C ends it", folder.display()))?;
    let site = Site { page, folder };
    http::serve(&listener, |request| site.answer(request));
    Ok(())
}
