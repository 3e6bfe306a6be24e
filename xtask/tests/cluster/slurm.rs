//! A Slurm cluster of one node on this machine. All its files are in a folder of its own, so
//! nothing of a cluster that may be installed here is touched.

use std::{
    ffi::OsStr,
    fs,
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use xtask::system::{at, output};

/// The programs that are needed.
pub(super) const PROGRAMS: [&str; 6] = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol"];

/// Longest time until the node is up.
const START: Duration = Duration::from_secs(90);

/// A running cluster; stopped when dropped.
pub(super) struct Slurm {
    place: PathBuf,
    config: PathBuf,
}

impl Slurm {
    /// Starts the cluster. Its files are in `place`.
    pub(super) fn start(place: &Path) -> Result<Self, String> {
        let slurm = Self { place: place.to_owned(), config: place.join("slurm.conf") };
        slurm.write_files().map_err(at(place))?;
        slurm.start_munge()?;
        // The daemons go into the background by themselves.
        for daemon in ["slurmctld", "slurmd"] {
            let started = slurm.program(daemon).stdout(Stdio::null()).stderr(Stdio::null()).status();
            if !started.is_ok_and(|status| status.success()) {
                return Err(format!(
                    "{daemon} does not start: see {}",
                    place.join(daemon).with_extension("log").display()
                ));
            }
        }
        let started = Instant::now();
        while slurm.run("sinfo", &["--noheader", "--format=%T"]).is_ok_and(|state| state.trim() != "idle") {
            if started.elapsed() > START {
                return Err(format!("the node is not up after {START:?}: see {}", place.join("slurmd.log").display()));
            }
            thread::sleep(Duration::from_millis(200));
        }
        Ok(slurm)
    }

    fn write_files(&self) -> std::io::Result<()> {
        for folder in ["state", "spool"] {
            fs::create_dir(self.place.join(folder))?;
        }
        let name = |program: &str, flag: &str| -> std::io::Result<String> {
            Ok(String::from_utf8_lossy(&Command::new(program).arg(flag).output()?.stdout).trim().to_owned())
        };
        let (host, user) = (name("hostname", "-s")?, name("id", "-un")?);
        let place = self.place.display();
        // Free ports, chosen by the system.
        let (one, other) = (TcpListener::bind("127.0.0.1:0")?, TcpListener::bind("127.0.0.1:0")?);
        let (control, node) = (one.local_addr()?.port(), other.local_addr()?.port());
        // A task that is requeued waits until its credential has expired.
        let config = format!(
            "ClusterName=gs\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser={user}\nSlurmdUser={user}\n\
            SlurmctldPort={control}\nSlurmdPort={node}\n\
            AuthType=auth/munge\nAuthInfo=socket={place}/munge.socket,cred_expire=5\n\
            StateSaveLocation={place}/state\nSlurmdSpoolDir={place}/spool\n\
            SlurmctldPidFile={place}/slurmctld.pid\nSlurmdPidFile={place}/slurmd.pid\n\
            SlurmctldLogFile={place}/slurmctld.log\nSlurmdLogFile={place}/slurmd.log\n\
            ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nMpiDefault=none\n\
            SelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\n\
            SchedulerParameters=sched_interval=1,batch_sched_delay=0,sched_min_interval=0\nKillWait=10\n\
            NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory=500 State=UNKNOWN\n\
            PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n"
        );
        fs::write(&self.config, config)
    }

    /// Starts the service by which the daemons recognize each other.
    fn start_munge(&self) -> Result<(), String> {
        let file = |name: &str| self.place.join(name).display().to_string();
        let key = file("munge.key");
        output(Command::new("sh").args(["-c", "umask 077; head -c 1024 /dev/urandom > \"$0\"", &key]))?;
        output(Command::new("munged").arg("--force").args([
            format!("--key-file={key}"),
            format!("--socket={}", file("munge.socket")),
            format!("--pid-file={}", file("munged.pid")),
            format!("--log-file={}", file("munged.log")),
            format!("--seed-file={}", file("munge.seed")),
        ]))
        .map(drop)
    }

    fn program(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        command.env("SLURM_CONF", &self.config).stdin(Stdio::null());
        command
    }

    /// Runs a program of Slurm and returns its output.
    pub(super) fn run(&self, program: &str, arguments: &[&str]) -> Result<String, String> {
        output(self.program(program).args(arguments))
    }

    /// Runs a program that uses this cluster, in the cluster's folder, and returns its output.
    pub(super) fn command<A: AsRef<OsStr>>(
        &self,
        program: &Path,
        arguments: impl IntoIterator<Item = A>,
    ) -> Result<String, String> {
        output(self.program(program).current_dir(&self.place).args(arguments))
    }

    /// The tasks of a job that have not ended, with their states.
    pub(super) fn states(&self, job: &str) -> Result<Vec<(String, String)>, String> {
        let listed = self.run("squeue", &["--noheader", "--array", "--format=%i %T"])?;
        let pair = |line: &str| line.split_once(' ').map(|(task, state)| (task.to_owned(), state.trim().to_owned()));
        let of_job = format!("{job}_");
        Ok(listed.lines().filter_map(pair).filter(|(task, _)| task.starts_with(&of_job)).collect())
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // Tasks first, so that none is left without its daemon.
        let _ = self.run("scancel", &["--full", "--state=RUNNING"]);
        let _ = self.run("scontrol", &["shutdown"]);
        for daemon in ["slurmd", "slurmctld", "munged"] {
            let Ok(process) = fs::read_to_string(self.place.join(daemon).with_extension("pid")) else { continue };
            let _ = Command::new("kill").arg(process.trim()).stderr(Stdio::null()).status();
        }
    }
}
