//! From TOML to a checked plan.

use crate::plan::{
    Claim, ClaimPart, Condition, Control, Data, Judging, LessonPlan, Plan, Published, Relation, Row,
};
use crate::{CompareError, Figure};
use senda_nets::{Colour, Crop};
use senda_toml::nearest_names;
use std::path::{Path, PathBuf};

type Source<'a> = senda_toml::Source<'a, CompareError>;
type Table<'a> = senda_toml::Table<'a, CompareError>;

/// More than these make no table that anybody reads (guesses that keep a slip of the pen from costing a week).
const MOST_ROWS: usize = 200;
const MOST_SEEDS: u64 = 1000;
const MOST_WORLDS: usize = 1000;

pub(crate) fn plan(source_name: &str, text: &str) -> Result<Plan, CompareError> {
    let source = Source::new(source_name, text);
    let mut file = source.table()?;
    let name = match file.optional_string("name")? {
        Some(name) => name,
        None => return Err(file.missing("name", "a name in quotes")),
    };
    let description = file.optional_string("description")?.unwrap_or_default();
    let vehicle = file.optional_string("vehicle")?.unwrap_or_else(|| "sedan".into());
    let speed_mps = file.f64("speed_mps", 0.01, 60.0, 8.0)?;
    let seeds = file.optional_u64("seeds", 1, MOST_SEEDS)?.unwrap_or(5);
    let Some(baseline) = file.optional_string("baseline")? else {
        return Err(file.missing("baseline", "the name of a row in quotes"));
    };
    let data = data(file.required_table("data")?)?;
    let lesson = lesson(file.required_table("training")?)?;
    let judging = judging(file.required_table("judging")?, &data)?;
    let row_tables = file.tables_at_most("row", MOST_ROWS)?;
    if row_tables.is_empty() {
        return Err(file.problem("row", "at least one row", "none", "write [[row]]"));
    }
    let rows = rows(row_tables, &[])?;
    if !rows.iter().any(|row| row.name == baseline) {
        let names: Vec<&str> = rows.iter().map(|row| row.name.as_str()).collect();
        return Err(unknown(&file, "baseline", "the name of a row", &baseline, &names));
    }
    let identities: Vec<String> = rows.iter().map(Row::identity).collect();
    let mut conditions = Vec::new();
    for table in file.tables_at_most("condition", 20)? {
        let condition = condition(table, &identities, &conditions)?;
        conditions.push(condition);
    }
    if conditions.is_empty() {
        conditions.push(Condition {
            name: "as it is".into(),
            latency_s: 0.0,
            lost_frames: 0.0,
            speed_mps: None,
            rows: Vec::new(),
        });
    }
    let names: Vec<&str> = conditions
        .iter()
        .map(|condition| condition.name.as_str())
        .collect();
    let mut claims = Vec::new();
    for table in file.tables_at_most("claim", 100)? {
        claims.push(claim(table, &identities, &names)?);
    }
    file.finish()?;
    Ok(Plan {
        name,
        description,
        vehicle,
        speed_mps,
        seeds,
        baseline,
        data,
        lesson,
        judging,
        conditions,
        rows,
        claims,
    })
}

/// The rows of a file that holds nothing else.
pub(crate) fn more_rows(source_name: &str, text: &str, known: &[String]) -> Result<Vec<Row>, CompareError> {
    let source = Source::new(source_name, text);
    let mut file = source.table()?;
    let tables = file.tables_at_most("row", MOST_ROWS)?;
    file.finish()?;
    if tables.is_empty() {
        return Err(file.problem("row", "at least one row", "none", "write [[row]]"));
    }
    rows(tables, known)
}

fn unknown(table: &Table, key: &str, expected: &str, found: &str, known: &[&str]) -> CompareError {
    let help = match nearest_names(found, known).first() {
        Some(name) => format!("did you mean {name:?}?"),
        None => format!("known: {}", known.join(", ")),
    };
    table.problem(key, expected, format!("{found:?}"), help)
}

fn worlds(table: &mut Table, key: &'static str, may_be_empty: bool) -> Result<Vec<String>, CompareError> {
    let worlds = table.optional_strings(key)?.unwrap_or_default();
    if worlds.len() > MOST_WORLDS {
        return Err(table.problem(
            key,
            format!("at most {MOST_WORLDS} worlds"),
            worlds.len().to_string(),
            "",
        ));
    }
    if worlds.is_empty() && !may_be_empty {
        return Err(table.problem(
            key,
            "at least one world",
            "none",
            "name worlds as `senda drive --world` does",
        ));
    }
    Ok(worlds)
}

fn data(mut table: Table) -> Result<Data, CompareError> {
    let data = Data {
        driver: table.optional_string("driver")?.unwrap_or_else(|| "human".into()),
        training: worlds(&mut table, "training", false)?,
        tuning: worlds(&mut table, "tuning", true)?,
        held_out: worlds(&mut table, "held_out", false)?,
        side_camera_shift: table.f64("side_camera_shift", 0.0, 1.0, 0.2)?,
        time_limit_s: table.optional_f64("time_limit_s", 0.1, 1e6)?,
    };
    table.finish()?;
    unseen(&table, "held_out", &data.held_out, &data)?;
    Ok(data)
}

/// Refuses worlds that were learned from or tuned on. Only names are compared here, so that the error has a line; their content
/// is when the worlds are read.
fn unseen(table: &Table, key: &str, worlds: &[String], data: &Data) -> Result<(), CompareError> {
    let seen = |world: &&String| data.training.contains(world) || data.tuning.contains(world);
    match worlds.iter().find(seen) {
        None => Ok(()),
        Some(world) => Err(table.problem(
            key,
            "worlds that are neither learned from nor tuned on",
            format!("{world:?}"),
            "take another world, or another seed of a random one",
        )),
    }
}

fn lesson(mut table: Table) -> Result<LessonPlan, CompareError> {
    let whole = |number: Option<usize>, default| number.unwrap_or(default);
    let lesson = LessonPlan {
        epochs: whole(table.optional_whole("epochs", 1, 100_000)?, 10) as u32,
        batch: whole(table.optional_whole("batch", 1, 65_536)?, 32),
        streams: whole(table.optional_whole("streams", 1, 65_536)?, 8),
        sequence: whole(table.optional_whole("sequence", 1, 1024)?, 16),
        learning_rate: table.f64("learning_rate", 1e-9, 10.0, 1e-3)?,
        smooth: table.bool("smooth", false)?,
        mirror: table.f64("mirror", 0.0, 1.0, 0.5)?,
    };
    table.finish()?;
    Ok(lesson)
}

fn judging(mut table: Table, data: &Data) -> Result<Judging, CompareError> {
    let judging = Judging {
        worlds: worlds(&mut table, "worlds", false)?,
        starts: table
            .optional_numbers("starts", 0.0, 1.0)?
            .unwrap_or_else(|| vec![0.0]),
        patience: table.f64("patience", 1.0, 100.0, 2.0)?,
        time_limit_s: table.optional_f64("time_limit_s", 0.1, 1e6)?,
    };
    if judging.starts.is_empty() {
        return Err(table.problem("starts", "at least one start", "none", "0 is the world's own"));
    }
    table.finish()?;
    unseen(&table, "worlds", &judging.worlds, data)?;
    Ok(judging)
}

fn rows(tables: Vec<Table>, known: &[String]) -> Result<Vec<Row>, CompareError> {
    let mut rows: Vec<Row> = Vec::with_capacity(tables.len());
    for table in tables {
        let is_known = |identity: &str| {
            known.iter().any(|known| known == identity) || rows.iter().any(|row| row.identity() == identity)
        };
        let row = row(table, &is_known)?;
        rows.push(row);
    }
    Ok(rows)
}

fn row(mut table: Table, is_known: &dyn Fn(&str) -> bool) -> Result<Row, CompareError> {
    let Some(name) = table.optional_string("name")? else {
        return Err(table.missing("name", "a name in quotes"));
    };
    if name.trim().is_empty() || name.contains(['/', '|', '\n']) {
        return Err(table.problem("name", "a name without / and |", format!("{name:?}"), ""));
    }
    let Some(network) = table.optional_string("network")? else {
        return Err(table.missing("network", "a ready network or a network file"));
    };
    if let Err(error) = senda_learn::learn::find_network(&network) {
        return Err(table.problem(
            "network",
            "a ready network or a network file",
            format!("{network:?}"),
            error.to_string(),
        ));
    }
    let words = Control::ALL.map(|(word, _)| word);
    let word = table.optional_word("control", &words)?.unwrap_or("steering");
    let control = Control::ALL
        .iter()
        .find(|(own, _)| *own == word)
        .map_or(Control::Steering, |(_, control)| *control);
    let colour = table
        .optional_word("colour", &["rgb", "grey", "saturation"])?
        .map(|word| match word {
            "rgb" => Colour::Rgb,
            "grey" => Colour::Grey,
            _ => Colour::Saturation,
        });
    let crop = match table.optional_table("crop")? {
        None => Crop::default(),
        Some(mut table) => {
            let crop = Crop {
                top: table.f64("top", 0.0, 0.95, 0.0)?,
                bottom: table.f64("bottom", 0.0, 0.95, 0.0)?,
                left: table.f64("left", 0.0, 0.95, 0.0)?,
                right: table.f64("right", 0.0, 0.95, 0.0)?,
            };
            table.finish()?;
            crop
        }
    };
    let from = table.optional_string("from")?;
    if let Some(from) = &from
        && !Path::new(from).is_file()
    {
        return Err(table.problem(
            "from",
            "a file with weights (a model, safetensors or ONNX)",
            format!("{from:?}"),
            "there is no such file",
        ));
    }
    let row = Row {
        name,
        network,
        control,
        colour,
        crop,
        edges: table.bool("edges", false)?,
        quick: table.bool("quick", false)?,
        from: from.map(PathBuf::from),
        stack: table.optional_whole("stack", 1, 16)?,
        epochs: table
            .optional_whole("epochs", 1, 100_000)?
            .map(|epochs| epochs as u32),
        sequence: table.optional_whole("sequence", 1, 1024)?,
        published: match table.optional_table("published")? {
            Some(table) => Some(published(table)?),
            None => None,
        },
    };
    table.finish()?;
    if let Err(error) = crate::job::prepared(&row) {
        return Err(table.problem(
            "network",
            "a network that fits the row's treatment",
            format!("{:?}", row.network),
            error,
        ));
    }
    let identity = row.identity();
    if is_known(&identity) {
        let found = format!("{identity:?} a second time");
        return Err(table.problem("name", "a row that is there once", found, "give it another name"));
    }
    Ok(row)
}

fn published(mut table: Table) -> Result<Published, CompareError> {
    let published = Published {
        lane_mean_m: table.required_f64("lane_mean_m", 0.0, 1e3)?,
        lane_max_m: table.required_f64("lane_max_m", 0.0, 1e3)?,
        heading_mean_deg: table.required_f64("heading_mean_deg", 0.0, 180.0)?,
        heading_max_deg: table.required_f64("heading_max_deg", 0.0, 180.0)?,
        rmse: table.required_f64("rmse", 0.0, 10.0)?,
        rmse_throttle: table.optional_f64("rmse_throttle", 0.0, 10.0)?,
        left_road: table.bool("left_road", false)?,
    };
    table.finish()?;
    Ok(published)
}

fn listed(table: &mut Table, key: &'static str, identities: &[String]) -> Result<Vec<String>, CompareError> {
    let names = table.optional_strings(key)?.unwrap_or_default();
    let known: Vec<&str> = identities.iter().map(String::as_str).collect();
    match names.iter().find(|name| !identities.contains(name)) {
        Some(name) => Err(unknown(table, key, "a row as NAME/CONTROL", name, &known)),
        None => Ok(names),
    }
}

fn condition(
    mut table: Table,
    identities: &[String],
    before: &[Condition],
) -> Result<Condition, CompareError> {
    let Some(name) = table.optional_string("name")? else {
        return Err(table.missing("name", "a name in quotes"));
    };
    if before.iter().any(|condition| condition.name == name) {
        let found = format!("{name:?} a second time");
        return Err(table.problem("name", "a name that no other condition has", found, ""));
    }
    let condition = Condition {
        name,
        latency_s: table.f64("latency_s", 0.0, 10.0, 0.0)?,
        lost_frames: table.f64("lost_frames", 0.0, 1.0, 0.0)?,
        speed_mps: table.optional_f64("speed_mps", 0.01, 60.0)?,
        rows: listed(&mut table, "rows", identities)?,
    };
    table.finish()?;
    if before.is_empty() && !condition.rows.is_empty() {
        let help = "put a condition without `rows` before it";
        return Err(table.problem(
            "rows",
            "all rows under the first condition: it makes the tables",
            "some",
            help,
        ));
    }
    Ok(condition)
}

fn claim(mut table: Table, identities: &[String], conditions: &[&str]) -> Result<Claim, CompareError> {
    let Some(says) = table.optional_string("says")? else {
        return Err(table.missing("says", "the claim in words"));
    };
    let mut parts = Vec::new();
    for mut table in table.tables("part")? {
        let words = Figure::ALL.map(Figure::word);
        let word = table.required_word("figure", &words)?;
        let relation = match table.required_word("relation", &["less", "more", "not-less"])? {
            "less" => Relation::Less,
            "more" => Relation::More,
            _ => Relation::NotLess,
        };
        let part = ClaimPart {
            says: table.optional_string("says")?.unwrap_or_default(),
            figure: Figure::named(word),
            relation,
            rows: listed(&mut table, "rows", identities)?,
            than: listed(&mut table, "than", identities)?,
            condition: table.optional_string("condition")?,
        };
        table.finish()?;
        if part.rows.is_empty() || part.rows.len() != part.than.len() {
            let found = format!("{} and {}", part.rows.len(), part.than.len());
            return Err(table.problem("than", "as many rows as in `rows`, at least one", found, ""));
        }
        if let Some(name) = part
            .condition
            .as_deref()
            .filter(|name| !conditions.contains(name))
        {
            return Err(unknown(
                &table,
                "condition",
                "the name of a condition",
                name,
                conditions,
            ));
        }
        parts.push(part);
    }
    table.finish()?;
    if parts.is_empty() {
        return Err(table.problem("part", "at least one part", "none", "write [[claim.part]]"));
    }
    Ok(Claim { says, parts })
}
