//! A comparison in its folder: opened, worked on in whole or in part, joined from parts, read.

use crate::job::Jobs;
use crate::plan::Plan;
use crate::plots::{self, Laps};
use crate::results::Results;
use crate::work::{Crew, Done, Shop, write};
use crate::{CompareError, tables};
use senda_eval::report::Part;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

/// The plan as it was resolved.
const PLAN: &str = "plan.toml";
/// Held by the process that works in the folder.
const LOCK: &str = ".lock";
/// Which part of the jobs a folder was made for: `2/4`.
const PART: &str = "part.txt";

/// One of several parts of a comparison's jobs, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct PartOf {
    /// Which one.
    pub number: u64,
    /// Of how many.
    pub count: u64,
}

impl PartOf {
    /// All jobs.
    pub const WHOLE: Self = Self { number: 1, count: 1 };
}

impl std::str::FromStr for PartOf {
    type Err = CompareError;

    fn from_str(text: &str) -> Result<Self, CompareError> {
        let numbers = text
            .trim()
            .split_once('/')
            .and_then(|(number, count)| Some((number.parse().ok()?, count.parse().ok()?)));
        match numbers {
            Some((number, count)) if number >= 1 && number <= count && count <= 100_000 => {
                Ok(Self { number, count })
            }
            _ => Err(CompareError::Part {
                found: text.to_owned(),
            }),
        }
    }
}

impl std::fmt::Display for PartOf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

/// A plan with the folder that its results lie in.
#[derive(Debug)]
pub struct Comparison {
    plan: Plan,
    jobs: Jobs,
    folder: PathBuf,
}

/// How much work a part is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Amount {
    /// Jobs.
    pub jobs: usize,
    /// How many of them are done.
    pub done: usize,
    /// What the others take on one core, about (s).
    pub left_s: f64,
}

impl Comparison {
    /// A plan and the folder of its results, in which nothing is changed. Results of another plan serve where they are the same jobs.
    pub fn open(plan: Plan, folder: &Path) -> Result<Self, CompareError> {
        Ok(Self {
            jobs: Jobs::of(&plan)?,
            plan,
            folder: folder.to_owned(),
        })
    }

    /// Makes the folder, and writes the resolved plan. The folder is this process's alone as long as the lock lives.
    fn begin(&self) -> Result<File, CompareError> {
        let folder = &self.folder;
        std::fs::create_dir_all(folder).map_err(|source| CompareError::io(folder, source))?;
        let path = folder.join(LOCK);
        let lock = File::create(&path).map_err(|source| CompareError::io(&path, source))?;
        if let Err(TryLockError::WouldBlock) = lock.try_lock() {
            return Err(CompareError::Busy {
                folder: folder.clone(),
            });
        }
        write(&folder.join(PLAN), self.plan.to_toml().as_bytes())?;
        Ok(lock)
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    fn shop(&self) -> Shop<'_> {
        Shop {
            plan: &self.plan,
            jobs: &self.jobs,
            folder: &self.folder,
        }
    }

    fn wanted(&self, part: PartOf) -> Vec<usize> {
        let mut wanted = self.jobs.part(&self.plan, part.number - 1, part.count);
        wanted.retain(|task| self.jobs.tasks[*task].is_result());
        wanted
    }

    /// How much work a part is.
    pub fn amount(&self, part: PartOf) -> Amount {
        let (shop, wanted) = (self.shop(), self.wanted(part));
        let missing = shop.missing(&wanted);
        Amount {
            jobs: wanted.len(),
            done: wanted.iter().filter(|task| shop.is_done(**task)).count(),
            left_s: missing.iter().map(|task| self.jobs.tasks[*task].cost_s).sum(),
        }
    }

    /// Does what is missing of a part. What is done stays, whatever happens.
    pub fn work(&self, part: PartOf, crew: &Crew) -> Result<Done, CompareError> {
        let _lock = self.begin()?;
        if part.count > 1 {
            write(&self.folder.join(PART), format!("{part}\n").as_bytes())?;
        }
        self.shop().work(&self.wanted(part), crew)
    }

    /// The results, all of which must be there.
    pub fn results(&self) -> Result<Results, CompareError> {
        let shop = self.shop();
        let wanted = self.wanted(PartOf::WHOLE);
        let missing = wanted.iter().filter(|task| !shop.is_done(**task)).count();
        if missing > 0 {
            let folder = self.folder.display();
            return Err(CompareError::Missing {
                missing,
                total: wanted.len(),
                help: format!("go on with: senda compare {folder}/{PLAN} --folder {folder}"),
            });
        }
        Results::read(&shop)
    }

    /// All tables.
    pub fn tables(&self, results: &Results) -> Vec<Part> {
        tables::parts(&self.plan, results)
    }

    /// One lap of every row with pictures, and all plots. `None` when somebody interrupted.
    pub fn plots(&self, results: &Results, crew: &Crew) -> Result<Option<(Laps, Vec<Part>)>, CompareError> {
        let _lock = self.begin()?;
        let shop = self.shop();
        if shop.work(&shop.needed_for_plots(), crew)?.interrupted {
            return Ok(None);
        }
        let Some(laps) = shop.show(results, crew)? else {
            return Ok(None);
        };
        let beside_human = shop.beside_human(&laps)?;
        let parts = plots::parts(&self.plan.rows, &laps, &beside_human);
        Ok(Some((laps, parts)))
    }
}

/// Joins the folders of parts in one. The same part given twice changes nothing; what is missing is named with the command that makes
/// it.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Comparison, CompareError> {
    let mut plan: Option<(Plan, String)> = None;
    let mut given: Vec<PartOf> = Vec::new();
    for folder in folders {
        let path = folder.join(PLAN);
        let text = std::fs::read_to_string(&path).map_err(|source| CompareError::NoFolder {
            path: folder.clone(),
            source,
        })?;
        match &plan {
            None => plan = Some((Plan::parse(&path.display().to_string(), &text)?, text)),
            Some((_, first)) if *first != text => return Err(CompareError::OtherPlan { path }),
            Some(_) => {}
        }
        let path = folder.join(PART);
        if path.is_file() {
            let text = std::fs::read_to_string(&path).map_err(|source| CompareError::io(&path, source))?;
            given.push(text.parse()?);
        }
    }
    let Some((plan, _)) = plan else {
        return Err(CompareError::Missing {
            missing: 0,
            total: 0,
            help: "give the folders of all parts".into(),
        });
    };
    let whole = Comparison::open(plan, out)?;
    let _lock = whole.begin()?;
    let shop = whole.shop();
    for folder in folders {
        for task in whole.wanted(PartOf::WHOLE) {
            let name = whole.jobs.tasks[task].file();
            copy(&folder.join(&name), &shop.path(task))?;
        }
    }
    let wanted = whole.wanted(PartOf::WHOLE);
    let missing = wanted.iter().filter(|task| !shop.is_done(**task)).count();
    if missing == 0 {
        return Ok(whole);
    }
    let count = given.first().map_or(1, |part| part.count);
    let commands: Vec<String> = (1..=count)
        .map(|number| PartOf { number, count })
        .filter(|part| whole.amount(*part).left_s > 0.0)
        .map(|part| {
            let plan = out.join(PLAN);
            if count == 1 {
                return format!("senda compare {} --folder {}", plan.display(), out.display());
            }
            let what = if given.contains(&part) {
                "unfinished"
            } else {
                "missing"
            };
            let own = folders.iter().find(|folder| {
                std::fs::read_to_string(folder.join(PART)).is_ok_and(|text| text.trim() == part.to_string())
            });
            let folder = own.map_or_else(
                || format!("part-{}", part.number),
                |folder| folder.display().to_string(),
            );
            format!(
                "part {part} is {what}: senda compare {} --shard {part} --folder {folder}",
                plan.display()
            )
        })
        .collect();
    Err(CompareError::Missing {
        missing,
        total: wanted.len(),
        help: commands.join("; "),
    })
}

/// Copies a result that is not there yet. One that is there must be the same: the same job gives the same bytes.
fn copy(from: &Path, to: &Path) -> Result<(), CompareError> {
    if from == to || !from.is_file() {
        return Ok(());
    }
    let bytes = std::fs::read(from).map_err(|source| CompareError::io(from, source))?;
    if to.is_file() {
        let there = std::fs::read(to).map_err(|source| CompareError::io(to, source))?;
        if there != bytes {
            return Err(CompareError::Result {
                path: from.to_owned(),
                reason: format!("{} holds another result of the same job", to.display()),
            });
        }
        return Ok(());
    }
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).map_err(|source| CompareError::io(folder, source))?;
    }
    write(to, &bytes)
}
