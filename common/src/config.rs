//! Settings files: TOML over a struct with defaults.
//!
//! A settings struct derives `Serialize`, `Deserialize` and `Default` with
//! `#[serde(default, deny_unknown_fields)]`, nested structs too: then a file
//! holds only what differs from the defaults, and a misspelt key is an error.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};

use crate::{Error, Result};

/// What a number may be: one that decides how much memory or time is taken, or
/// by which something is divided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// The setting, with the tables it stands in: `cloud.half_width_m`; with a
    /// `*` in it all that begin and end so: `poles.*_m`.
    pub key: &'static str,
    /// Least value.
    pub least: f64,
    /// Largest value.
    pub most: f64,
    /// Whether it is an array that may not descend: from the least to the largest
    /// of something.
    pub ascends: bool,
}

/// The limits of a setting.
pub const fn limits(key: &'static str, least: f64, most: f64) -> Limits {
    Limits { key, least, most, ascends: false }
}

/// The limits of a setting that is a range: two numbers, the larger one last.
pub const fn range(key: &'static str, least: f64, most: f64) -> Limits {
    Limits { ascends: true, ..limits(key, least, most) }
}

impl Limits {
    fn are_of(&self, key: &str) -> bool {
        match self.key.split_once('*') {
            Some((begin, end)) => key.starts_with(begin) && key.ends_with(end),
            None => key == self.key,
        }
    }
}

/// Reads settings from a TOML file; what it does not say stays at its default.
///
/// # Errors
/// [`Error::UnknownKey`] with the line and the nearest known key,
/// [`Error::BadConfig`] for anything else that is wrong in the file, numbers
/// that are not finite included, [`Error::Io`] or [`Error::NotText`] where it
/// cannot be read.
pub fn load<T: DeserializeOwned + Serialize + Default>(path: impl AsRef<Path>) -> Result<T> {
    load_within(path, &[])
}

/// The same, where some numbers have limits: the first of those that are of a
/// setting.
///
/// # Errors
/// As [`load`], and [`Error::BadConfig`] where one is beyond its limits.
pub fn load_within<T: DeserializeOwned + Serialize + Default>(path: impl AsRef<Path>, limits: &[Limits]) -> Result<T> {
    let path = path.as_ref();
    let text = crate::text::read(path)?;
    let settings = parse(path, &text)?;
    let Ok(table) = DeTable::parse(&text) else { return Ok(settings) };
    check_numbers(table.get_ref(), "", limits).map_err(|(at, message)| Error::BadConfig {
        path: path.to_path_buf(),
        line: line_of(&text, at),
        message,
    })?;
    Ok(settings)
}

/// The same, or the defaults where there is no file.
///
/// # Errors
/// As [`load_within`].
pub fn load_or_default<T: DeserializeOwned + Serialize + Default>(path: Option<&Path>, limits: &[Limits]) -> Result<T> {
    path.map_or_else(|| Ok(T::default()), |path| load_within(path, limits))
}

/// Whether all numbers of a table are finite and within their limits; else what
/// is wrong, and at which byte.
fn check_numbers(table: &DeTable<'_>, prefix: &str, limits: &[Limits]) -> std::result::Result<(), (usize, String)> {
    for (key, value) in table {
        let full = format!("{prefix}{}", key.get_ref());
        if let DeValue::Table(inner) = value.get_ref() {
            check_numbers(inner, &format!("{full}."), limits)?;
        }
        let limits = limits.iter().find(|limits| limits.are_of(&full));
        if let Some(fault) = fault_of(&numbers(value.get_ref()), limits) {
            return Err((value.span().start, format!("`{full}` {fault}")));
        }
    }
    Ok(())
}

/// What is wrong with the numbers of a setting, if anything.
fn fault_of(numbers: &[f64], limits: Option<&Limits>) -> Option<String> {
    if let Some(number) = numbers.iter().find(|n| !n.is_finite()) {
        return Some(format!("is {number}, which is no finite number"));
    }
    let Limits { least, most, ascends, .. } = limits?;
    if let Some(number) = numbers.iter().find(|n| !(least..=most).contains(n)) {
        return Some(format!("is {number} and has to be from {least} to {most}"));
    }
    (*ascends && !numbers.is_sorted()).then(|| format!("is {numbers:?} and has to name the smaller number first"))
}

/// The numbers of a value or of an array of them.
fn numbers(value: &DeValue<'_>) -> Vec<f64> {
    match value {
        DeValue::Float(number) => number.as_str().parse().into_iter().collect(),
        DeValue::Integer(number) => {
            i64::from_str_radix(number.as_str(), number.radix()).map(|n| n as f64).into_iter().collect()
        }
        DeValue::Array(array) => array.iter().flat_map(|value| numbers(value.get_ref())).collect(),
        _ => Vec::new(),
    }
}

/// All settings as TOML, for `--print-config`.
///
/// # Errors
/// [`Error::BadConfig`] where `T` has no TOML form, which is a fault of `T`.
pub fn to_toml<T: Serialize>(settings: &T) -> Result<String> {
    toml::to_string_pretty(settings).map_err(|e| Error::BadConfig {
        path: std::any::type_name::<T>().into(),
        line: 1,
        message: e.to_string(),
    })
}

fn parse<T: DeserializeOwned + Serialize + Default>(path: &Path, text: &str) -> Result<T> {
    let as_it_is = toml::from_str(text);
    // What is wrong is told of the text as it is, but what is missing the defaults have.
    let is_right = as_it_is.as_ref().err().is_none_or(|e| e.message().starts_with("missing field "));
    let complete = is_right.then(|| completed(text)).flatten();
    complete.map_or(as_it_is, Ok).map_err(|e| {
        let line = e.span().map_or(1, |span| line_of(text, span.start));
        match unknown_field(e.message()) {
            Some((key, expected)) => Error::UnknownKey {
                path: path.to_path_buf(),
                line,
                nearest: nearest_key(key, &expected, &known_keys(&T::default())),
                key: key.to_owned(),
            },
            None => Error::BadConfig { path: path.to_path_buf(), line, message: e.message().replace('\n', ", ") },
        }
    })
}

/// As read where what the tables lack stands in them as in the defaults of the whole: some
/// tables are of one kind, but have other defaults in each place. None where they cannot
/// be completed so.
fn completed<T: DeserializeOwned + Serialize + Default>(text: &str) -> Option<T> {
    let defaults = toml::to_string(&T::default()).ok()?;
    let (mut table, defaults) = (DeTable::parse(text).ok()?, DeTable::parse(&defaults).ok()?);
    complete(table.get_mut(), defaults.get_ref());
    T::deserialize(toml::Deserializer::from(table)).ok()
}

/// Puts into a table, and those in it, what only the defaults have.
fn complete<'a>(table: &mut DeTable<'a>, defaults: &DeTable<'a>) {
    for (key, default) in defaults {
        match table.get_mut(key).map(toml::Spanned::get_mut) {
            Some(DeValue::Table(inner)) => {
                if let DeValue::Table(default) = default.get_ref() {
                    complete(inner, default);
                }
            }
            Some(_) => {}
            None => {
                table.insert(key.clone(), default.clone());
            }
        }
    }
}

/// The line (from 1) of a byte.
fn line_of(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|&b| b == b'\n').count()
}

/// The key and the expected ones out of serde's "unknown field `a`, expected
/// one of `b`, `c`": the only form in which serde hands them over.
fn unknown_field(message: &str) -> Option<(&str, Vec<&str>)> {
    let mut quoted = message.strip_prefix("unknown field ")?.split('`').skip(1).step_by(2);
    Some((quoted.next()?, quoted.collect()))
}

/// Every key of the defaults, with the tables it stands in: `poles.radius_m`.
fn known_keys<T: Serialize>(defaults: &T) -> Vec<String> {
    fn collect(table: &toml::Table, prefix: &str, keys: &mut Vec<String>) {
        for (key, value) in table {
            keys.push(format!("{prefix}{key}"));
            if let toml::Value::Table(inner) = value {
                collect(inner, &format!("{prefix}{key}."), keys);
            }
        }
    }
    let mut keys = Vec::new();
    if let Ok(table) = toml::Table::try_from(defaults) {
        collect(&table, "", &mut keys);
    }
    keys
}

/// Jaro-Winkler similarity from which a name of the same table may have been meant, and one
/// of another table.
const SIMILAR: f64 = 0.7;
const SIMILAR_ELSEWHERE: f64 = 0.9;

/// The key that was meant: the same name in another table, else the most
/// similar one here, else the most similar one anywhere.
fn nearest_key(key: &str, expected: &[&str], known: &[String]) -> Option<String> {
    let name = |full: &str| full.rsplit('.').next().unwrap_or_default().to_owned();
    if let Some(elsewhere) = known.iter().find(|full| name(full) == key) {
        return Some(elsewhere.clone());
    }
    let similar = |a: &str| strsim::jaro_winkler(a, key);
    let here = expected.iter().map(|&e| (similar(e), e.to_owned())).filter(|(similarity, _)| *similarity > SIMILAR);
    // Among hundreds of names one is a little like any word.
    let anywhere = known.iter().map(|full| (similar(&name(full)), full.clone()));
    let anywhere = anywhere.filter(|(similarity, _)| *similarity > SIMILAR_ELSEWHERE);
    here.chain(anywhere.map(|(similarity, full)| (similarity - 0.05, full)))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, nearest)| nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Settings {
        every: usize,
        only: Option<String>,
        poles: Poles,
        posts: Poles,
        pitch: Axis,
    }

    /// Has no default of its own.
    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Axis {
        walk: f64,
        memory_s: f64,
    }

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Poles {
        radius_m: f64,
        heights_m: [f64; 2],
    }

    impl Default for Settings {
        fn default() -> Self {
            Self {
                every: 5,
                only: None,
                poles: Poles::default(),
                posts: Poles { radius_m: 0.6, heights_m: [4.0, 12.0] },
                pitch: Axis { walk: 0.1, memory_s: 0.5 },
            }
        }
    }

    impl Default for Poles {
        fn default() -> Self {
            Self { radius_m: 0.3, heights_m: [1.0, 2.0] }
        }
    }

    fn message(text: &str) -> String {
        parse::<Settings>(Path::new("a.toml"), text).unwrap_err().to_string()
    }

    #[test]
    fn what_is_not_said_stays_at_its_default() {
        let settings: Settings = parse(Path::new("a.toml"), "[poles]\nradius_m = 0.5\n").unwrap();
        assert_eq!(settings, Settings { poles: Poles { radius_m: 0.5, ..Poles::default() }, ..Settings::default() });
    }

    #[test]
    fn what_a_table_does_not_say_is_that_of_its_place_and_not_of_its_kind() {
        let settings: Settings = parse(Path::new("a.toml"), "[posts]\nradius_m = 0.5\n").unwrap();
        let posts = Poles { radius_m: 0.5, heights_m: [4.0, 12.0] };
        assert_eq!(settings, Settings { posts, ..Settings::default() });
    }

    #[test]
    fn what_a_table_without_a_default_of_its_own_does_not_say_is_that_of_its_place() {
        let settings: Settings = parse(Path::new("a.toml"), "every = 3\n[pitch]\nwalk = 0.2\n").unwrap();
        let expected = Settings { every: 3, pitch: Axis { walk: 0.2, memory_s: 0.5 }, ..Settings::default() };
        assert_eq!(settings, expected);
        assert!(message("[pitch]\nwalk = 'much'\n").starts_with("a.toml:2: "));
        assert!(message("[pitch]\nwalk = 0.2\nwal = 1\n").starts_with("a.toml:3: there is no setting `wal`"));
    }

    #[test]
    fn an_unknown_key_names_file_line_and_nearest_key() {
        let said = message("every = 3\n[poles]\nradus_m = 0.5\n");
        assert!(said.starts_with("a.toml:3: there is no setting `radus_m` (did you mean `radius_m`?)"), "{said}");
        assert!(message("evry = 3").contains("`every`"));
        assert!(message("onli = 'x'").contains("`only`"));
    }

    #[test]
    fn a_key_in_the_wrong_table_is_shown_its_place() {
        assert!(message("radius_m = 0.5").contains("`poles.radius_m`"));
        assert!(message("raduis_m = 0.5").contains(".radius_m`?)"));
        // What is only a little like it is not taken for it.
        let said = message("rad = 0.5");
        assert!(said.contains("no setting `rad`;"), "{said}");
    }

    #[test]
    fn a_wrong_value_or_broken_toml_names_the_line() {
        assert!(message("every = 3\n[poles]\nradius_m = 'wide'").starts_with("a.toml:3: "));
        assert!(message("every = 3\n[poles\n").starts_with("a.toml:2: "));
    }

    #[test]
    fn a_number_beyond_its_limits_or_not_finite_names_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        let said = |text: &str| {
            std::fs::write(&file, text).unwrap();
            let read = load_within::<Settings>(
                &file,
                &[
                    range("poles.heights_m", 0.5, 9.0),
                    limits("poles.*_m", 0.01, 10.0),
                    limits("poles.radius_m", 3.0, 3.0),
                    limits("every", 1.0, 100.0),
                ],
            );
            read.map_err(|e| e.to_string())
        };
        assert!(said("every = 1\n[poles]\nradius_m = 10.0\n").is_ok());
        assert!(
            said("every = 3\n[poles]\nradius_m = 1_000.0\n")
                .unwrap_err()
                .contains("a.toml:3: `poles.radius_m` is 1000 and has to be from 0.01 to 10")
        );
        assert!(said("every = 0\n").unwrap_err().contains("a.toml:1: `every` is 0"));
        assert!(said("[poles]\nradius_m = nan\n").unwrap_err().contains("a.toml:2: `poles.radius_m` is NaN"));
        assert!(said("[poles]\nheights_m = [2.0, 2.0]\n").is_ok());
        assert!(
            said("[poles]\nheights_m = [3.0, 2.0]\n")
                .unwrap_err()
                .contains("a.toml:2: `poles.heights_m` is [3.0, 2.0] and has to name the smaller number first")
        );
    }

    #[test]
    fn printed_settings_are_read_back() {
        let settings = Settings { every: 7, ..Settings::default() };
        let text = to_toml(&settings).unwrap();
        assert_eq!(parse::<Settings>(Path::new("a.toml"), &text).unwrap(), settings);
    }
}
