//! The machine: its packages, cargo, and the folders of the workspace.

use std::{
    env,
    ffi::OsString,
    fs, io,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Stdio},
};

/// The version of the workspace.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What the flags of a command ask for.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Install what is needed.
    pub install: bool,
    /// Test.
    pub test: bool,
    /// Also run what takes long: tests marked `#[ignore]`, and the page's WebAssembly for one thread.
    pub slow: bool,
    /// The npm package instead of the page.
    pub package: bool,
}

impl Options {
    /// Reads flags, which must be among the `known` ones of a command.
    pub fn parse(flags: &[String], known: &[&str]) -> Result<Self, String> {
        if let Some(unknown) = flags.iter().find(|flag| !known.contains(&flag.as_str())) {
            return Err(format!("unknown flag {unknown}"));
        }
        let [install, test, slow, package] =
            ["--install", "--test", "--slow", "--package"].map(|flag| flags.iter().any(|given| given == flag));
        Ok(Self { install, test, slow, package })
    }
}

/// Whether there is a program of this name.
pub fn has_program(name: &str) -> bool {
    let paths = env::var_os("PATH").unwrap_or_default();
    let file = Path::new(name).with_extension(env::consts::EXE_EXTENSION);
    env::split_paths(&paths).chain(["/usr/sbin".into()]).any(|folder| folder.join(&file).is_file())
}

/// Whether this process runs as root.
pub fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

/// A command that runs as root, through sudo if necessary.
pub fn root(program: &str) -> Command {
    if is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("sudo");
    command.arg(program);
    command
}

/// Installs packages of Debian or Ubuntu, as root or through sudo, while no other process of this program
/// does: `apt-get` fails where another one is at work.
pub fn install_packages(packages: &[&str]) -> Result<(), String> {
    let lock = target().join("packages.lock");
    let locked = || {
        fs::create_dir_all(target())?;
        let file = fs::File::create(&lock)?;
        file.lock().map(|()| file)
    };
    let lock = locked().map_err(at(&lock))?;
    let apt = |arguments: &[&str]| {
        let mut command = root("apt-get");
        step(
            command
                .args(["--quiet", "--yes", "-o", "DPkg::Lock::Timeout=300"])
                .args(arguments)
                .env("DEBIAN_FRONTEND", "noninteractive"),
        )
    };
    // Package lists may be old, or absent as in a fresh container.
    let install = [&["install", "--no-install-recommends"], packages].concat();
    let installed = apt(&install).or_else(|_| apt(&["update"]).and_then(|()| apt(&install)));
    drop(lock);
    installed
}

/// Runs cargo in the workspace, under a line that shows the command.
pub fn cargo(arguments: &[&str]) -> Result<(), String> {
    step(Command::new(cargo_program()).args(arguments).current_dir(workspace()))
}

/// The first argument of a test in `tests/`, which does nothing without it: it needs programs that most machines do
/// not have, and minutes.
pub const START: &str = "--start";

/// Runs a test in `tests/`, which may install what it needs.
pub fn start_test(name: &str, install: bool) -> Result<(), String> {
    let mut test = Command::new(cargo_program());
    test.args(["test", "--locked", "--quiet", "--package", "xtask", "--test", name, "--", START]);
    test.args(install.then_some("--install")).current_dir(workspace());
    match test.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(_) => Err(format!("the test of cargo xtask {name} failed")),
        Err(error) => Err(format!("cargo could not be started: {error}")),
    }
}

/// What a test in `tests/` does: nothing, unless [`start_test`] has started it.
pub fn started(test: impl FnOnce(Options) -> Result<(), String>) -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    if arguments.first().is_none_or(|first| first != START) {
        return ExitCode::SUCCESS;
    }
    match Options::parse(&arguments[1..], &["--install"]).and_then(test) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

/// Builds the Python module for tests, and returns the folder that it is in.
pub fn built_module() -> Result<PathBuf, String> {
    build(&["--lib", "--example", "adapters"])
}

/// Builds `gs` for tests, and returns its path.
pub fn built_program() -> Result<PathBuf, String> {
    // The example brings the features of tests: without them, the tests' build of `gs` would be replaced.
    let folder = build(&["--bin", "gs", "--example", "adapters"])?;
    Ok(folder.join("gs").with_extension(env::consts::EXE_EXTENSION))
}

/// Builds an example of the workspace for tests, and returns its path.
pub fn built_example(name: &str) -> Result<PathBuf, String> {
    let folder = build(&["--example", name])?;
    Ok(folder.join("examples").join(name).with_extension(env::consts::EXE_EXTENSION))
}

/// Builds with the features of the whole workspace, so that nothing is built again that the tests have
/// built, and returns the folder of the results.
fn build(targets: &[&str]) -> Result<PathBuf, String> {
    cargo(&[&["build", "--locked", "--workspace"], targets].concat())?;
    Ok(target().join("debug"))
}

/// The folder of what is built.
pub fn target() -> PathBuf {
    env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace().join("target"), PathBuf::from)
}

/// A command as it would be typed.
pub fn line(command: &Command) -> String {
    let words = [command.get_program()].into_iter().chain(command.get_args());
    words.map(|word| word.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
}

/// Runs a command under a line that shows it.
pub fn step(command: &mut Command) -> Result<(), String> {
    let line = line(command);
    eprintln!("== {line}");
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{line}: {status}")),
        Err(error) => Err(format!("{line}: could not be started: {error}")),
    }
}

/// Runs a command and returns its standard output. Its standard error is part of an error.
pub fn output(command: &mut Command) -> Result<String, String> {
    let line = line(command);
    let ended = command.stdin(Stdio::null()).output().map_err(|error| format!("{line}: {error}"))?;
    let [results, errors] = [ended.stdout, ended.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    match ended.status.success() {
        true => Ok(results),
        false => Err(format!("{line}: {}: {}", ended.status, if errors.is_empty() { results } else { errors })),
    }
}

/// The message of an error at a path.
pub fn at(path: &Path) -> impl Fn(io::Error) -> String {
    move |error| format!("{}: {error}", path.display())
}

/// The files and folders in a folder.
pub fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let read = fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    read.map_err(at(folder))
}

/// Removes a folder that may be there.
pub fn remove(folder: &Path) -> Result<(), String> {
    if folder.exists() { fs::remove_dir_all(folder).map_err(at(folder)) } else { Ok(()) }
}

/// Makes an empty folder, in place of one that may be there.
pub fn empty(folder: &Path) -> Result<(), String> {
    remove(folder)?;
    fs::create_dir_all(folder).map_err(at(folder))
}

/// Copies a file, and makes the folders above it.
pub fn copy(from: &Path, to: &Path) -> Result<(), String> {
    let folder = to.parent().unwrap_or(to);
    let copied = fs::create_dir_all(folder).and_then(|()| fs::copy(from, to));
    copied.map(drop).map_err(|error| format!("{} to {}: {error}", from.display(), to.display()))
}

/// Checks that the compiler has a target, or installs it.
pub fn need_target(triple: &str, install: bool) -> Result<(), String> {
    // Without rustup, the compiler says what it lacks.
    let listed = Command::new("rustup").args(["target", "list", "--installed"]).output();
    if listed.map_or(true, |output| String::from_utf8_lossy(&output.stdout).lines().any(|line| line == triple)) {
        return Ok(());
    }
    if install {
        return step(Command::new("rustup").args(["target", "add", triple]));
    }
    Err(format!("the target {triple} isn't installed: rustup target add {triple}, or --install"))
}

/// What the compiler prints, without the line's end; empty if it cannot be run.
pub fn rustc(arguments: &[&str]) -> String {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let printed = Command::new(rustc).args(arguments).current_dir(workspace()).output();
    printed.map_or_else(|_| String::new(), |output| String::from_utf8_lossy(&output.stdout).trim_end().to_owned())
}

/// The compiler's flags that keep this machine's folders out of what it builds, so that the same sources
/// give the same bits anywhere.
pub fn remapped_paths() -> Vec<String> {
    let home = || env::home_dir().map(|home| home.join(".cargo"));
    let mut folders = vec![(workspace(), "gs".to_owned()), (target(), "target".to_owned())];
    folders.extend(env::var_os("CARGO_HOME").map(PathBuf::from).or_else(home).map(|home| (home, "cargo".to_owned())));
    let version = rustc(&["-vV"]);
    // As without the component rust-src.
    if let Some(commit) = version.lines().find_map(|line| line.strip_prefix("commit-hash: ")) {
        let sources = Path::new(&rustc(&["--print", "sysroot"])).join("lib/rustlib/src/rust");
        folders.push((sources, format!("/rustc/{commit}")));
    }
    folders.iter().map(|(folder, name)| format!("--remap-path-prefix={}={name}", folder.display())).collect()
}

/// The cargo that runs this program, so that both use one toolchain.
pub fn cargo_program() -> OsString {
    env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// The folder of the workspace.
pub fn workspace() -> PathBuf {
    let manifest = env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    manifest.parent().map_or_else(|| ".".into(), Path::to_path_buf)
}
