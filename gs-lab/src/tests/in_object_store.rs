//! A study whose runs are in an object store.

use gs_jobs::{files::RUNS, store::test_server::Server};

use crate::{
    Existing, StudyFolder, conduct,
    result::Results,
    run::Conducted,
    study::{Places, Plan, Study},
};
use gs_jobs::WorkSettings;

#[test]
fn the_tables_of_a_study_in_an_object_store_are_those_of_one_in_a_folder() {
    let text = "name = 'x'\nimages = ['paper-64px']\nbudgets = [40]\nseeds = [0, 1]\npreset = 'paper'\niterations = 60\n\
        [[arm]]\nname = 'none'\nsettings.policy.kind = 'none'\n[[arm]]\nname = 'grown'\nsettings.policy.kind = 'percentile'\n";
    let plan = Plan::new(Study::from_toml(text, "x.toml").unwrap(), &Places::default(), "test").unwrap();
    let place = tempfile::tempdir().unwrap();
    let server = Server::start(None);
    let cpu = || gs_cpu::CpuRasterizer::new(gs_cpu::CpuSettings::default().with(|s| s.threads = Some(1))).unwrap();
    let prepared = |name: &str| StudyFolder::prepare(&place.path().join(name), &plan, Existing::Refuse).unwrap();
    let (alone, shared) = (prepared("alone"), prepared("shared").with_store(server.store("study")));
    assert_eq!(conduct(&plan, &[&cpu()], &alone, &WorkSettings::default(), &()).unwrap(), Conducted::Whole);
    assert_eq!(conduct(&plan, &[&cpu(), &cpu()], &shared, &WorkSettings::default(), &()).unwrap(), Conducted::Whole);
    let written = |folder: &StudyFolder| {
        let results = Results::read(&plan, folder).unwrap();
        assert_eq!(results.missing().count(), 0);
        crate::report::write(&results, folder, "gs study x.toml").unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.file(name)).unwrap();
        let page = read("report.html");
        (["runs.csv", "quality.csv", "differences.csv", "results.json"].map(read), page.matches("src=\"data:").count())
    };
    assert_eq!(written(&shared), written(&alone));
    assert_eq!(std::fs::read_dir(shared.file(RUNS)).unwrap().count(), 0);
    assert_eq!(shared.ended().unwrap().len(), 4);
    shared.sweep().unwrap();
    assert_eq!(server.store("study").names(RUNS).unwrap().len(), 4, "records and nothing else");
}
