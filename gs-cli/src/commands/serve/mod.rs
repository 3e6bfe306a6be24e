//! `gs serve`: the page, and the scenes and runs of a folder, for browsers of this machine.

mod answer;
mod listing;

use std::{
    net::{IpAddr, Ipv4Addr, SocketAddr},
    path::PathBuf,
    rc::Rc,
};

use clap::Args;
use hyper::{server::conn::http1, service::service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::{net::TcpListener, runtime, task::LocalSet};

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
    let runtime = runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::failed)?;
    LocalSet::new().block_on(&runtime, serve(SocketAddr::new(args.host, args.port), Site { page, folder }))
}

async fn serve(address: SocketAddr, site: Site) -> Result<(), Failure> {
    let busy = |error| Failure::failed(error).at(address).hint("--port names another port");
    let listener = TcpListener::bind(address).await.map_err(busy)?;
    let bound = listener.local_addr().map_err(Failure::failed)?;
    output::result(format_args!("http://{bound}/ shows {}; Ctrl-C ends it", site.folder.display()))?;
    let site = Rc::new(site);
    loop {
        // A connection that fails before it is accepted is no reason to end.
        let Ok((stream, _)) = listener.accept().await else { continue };
        let site = site.clone();
        tokio::task::spawn_local(async move {
            let service = service_fn(move |request| {
                let site = site.clone();
                async move { Ok::<_, std::convert::Infallible>(site.answer(&request)) }
            });
            let mut http = http1::Builder::new();
            // The timer ends connections that never send a request.
            http.timer(TokioTimer::new());
            // A browser may close a connection at any time.
            let _closed = http.serve_connection(TokioIo::new(stream), service).await;
        });
    }
}
