//! The file of hard cases: parse, put the parameter's values into expressions, resolve lights and rigs with the places of mistakes.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};

use super::expression::Expression;
use super::measure::{COLUMNS, CurveId};
use crate::experiment::{AxisValue, AxisValues, CheckSettings, Document, Override, take_table};
use crate::input::{Finite, Finite3, InputError, Source, Spanned};
use crate::light::{Light, LightFile, LightModel, shader_kinds};
use crate::rig::{AnyRig, Centers, Rbf, RigFile};
use crate::scene::{OrientedBox, root};
use crate::sh::{Lobe, MAX_ORDER};

/// The word of `kind` that says that a file holds hard cases.
const KIND: &str = "stability";

/// The model that is no rig.
const DIRECT: &str = "direct";

/// An experiment of hard cases.
#[derive(Clone, Debug)]
pub struct HardCases {
    pub path: PathBuf,
    pub root: PathBuf,
    pub name: String,
    pub title: String,
    pub orders: Vec<usize>,
    /// Backends by their words.
    pub cpu: bool,
    pub gpu: bool,
    pub families: Vec<Family>,
    pub bounds: Vec<Bound>,
    /// What `rigbench check` forgives.
    pub check: CheckSettings,
    /// What the command line changed, as it was written there.
    pub changes: Vec<String>,
}

/// Cases that approach a singularity by a parameter.
#[derive(Clone, Debug)]
pub struct Family {
    pub name: String,
    pub title: String,
    /// What the parameter is.
    pub parameter: String,
    pub models: Vec<Model>,
    pub orders: Vec<usize>,
    /// One a value of the parameter.
    pub cases: Vec<Case>,
}

/// What lights the points: a rig, or every light at every point, by its exact formula (`direct`) or by another (its word).
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    pub name: String,
    pub direct: bool,
    pub formula: LightModel,
}

impl Model {
    fn rig(name: &str) -> Self {
        Self { name: name.to_owned(), direct: false, formula: LightModel::EXACT }
    }

    /// `direct`, or the word of a formula.
    fn of_lights(word: &str) -> Option<Self> {
        let formula = if word == DIRECT { Some(LightModel::EXACT) } else { formula(word) };
        formula.map(|formula| Self { name: word.to_owned(), direct: true, formula })
    }
}

/// The formula of a word, but for the exact one.
fn formula(word: &str) -> Option<LightModel> {
    LightModel::named(word).filter(|formula| *formula != LightModel::EXACT)
}

/// The words of formulas.
fn formula_words() -> impl Iterator<Item = &'static str> {
    LightModel::words().into_iter().filter(|word| formula(word).is_some())
}

/// A family at one value of its parameter.
#[derive(Clone, Debug)]
pub struct Case {
    pub t: f64,
    pub lights: Vec<Light<f64>>,
    pub bounds: OrientedBox,
    /// a of the receivers' wrap lobe.
    pub wrap: f64,
    pub places: Vec<Place>,
    /// One a model of the family; `None` is `direct`.
    pub rigs: Vec<Option<AnyRig>>,
}

/// A place with the normals asked for there.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    pub position: DVec3,
    pub normals: Vec<DVec3>,
}

/// A threshold: what some curves must hold at every value of the parameter (for `max`), or reach somewhere (for `reaches`).
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// Column and allowed words; a column that is not named may be anything.
    pub wanted: Vec<(String, Vec<String>)>,
    pub metric: String,
    /// The largest value of a curve is at most this.
    pub max: Option<f64>,
    /// The largest value of a curve is at least this: for naive forms, which are here to fail.
    pub reaches: Option<f64>,
    pub line: usize,
}

/// The columns by which thresholds and filters choose curves.
pub const CHOICES: [&str; 4] = ["family", "model", "order", "backend"];

/// Whether a file holds hard cases; a file that is no TOML holds none (its own reader says what is wrong).
pub fn is_stability(path: &Path) -> bool {
    let Ok(source) = Source::read(path) else { return false };
    let Ok(tree) = DeTable::parse(&source.text) else { return false };
    tree.get_ref().get("kind").and_then(|kind| kind.get_ref().as_str()) == Some(KIND)
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileHead {
    schema_version: Spanned<i64>,
    name: Spanned<String>,
    #[serde(default)]
    title: String,
    #[allow(dead_code, reason = "it chose this reader")]
    kind: String,
    matrix: MatrixFile,
    #[serde(default)]
    threshold: Vec<Spanned<BoundFile>>,
    check: Option<CheckFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckFile {
    error: Option<Spanned<Finite>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MatrixFile {
    rig: Spanned<Vec<Spanned<String>>>,
    order: Spanned<Vec<Spanned<i64>>>,
    backend: Spanned<Vec<Spanned<String>>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct BoundFile {
    #[serde(rename = "where", default)]
    wanted: BTreeMap<Spanned<String>, Spanned<AxisValues>>,
    metric: Spanned<String>,
    max: Option<Finite>,
    reaches: Option<Finite>,
}

/// What of a family does not depend on the parameter.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FamilyHead {
    name: Spanned<String>,
    #[serde(default)]
    title: String,
    parameter: Spanned<ParameterFile>,
    rig: Option<Spanned<Vec<Spanned<String>>>>,
    order: Option<Spanned<Vec<Spanned<i64>>>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ParameterFile {
    name: String,
    from: Option<Spanned<Finite>>,
    to: Option<Spanned<Finite>>,
    steps: Option<Spanned<i64>>,
    values: Option<Spanned<Vec<Finite>>>,
    #[serde(default)]
    also: Vec<Finite>,
}

/// What does.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CaseFile {
    #[serde(rename = "box")]
    bounds: Spanned<BoxFile>,
    #[serde(default)]
    light: Vec<Spanned<LightFile<NoPath>>>,
    point: Spanned<Vec<PlaceFile>>,
    #[serde(rename = "move")]
    moved: Option<Finite3>,
    wrap: Option<Spanned<Finite>>,
    #[serde(default)]
    variant: BTreeMap<Spanned<String>, Spanned<RigFile>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct BoxFile {
    center: Option<Finite3>,
    half: Spanned<Finite3>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaceFile {
    position: Finite3,
    #[serde(default)]
    normals: Vec<Spanned<Finite3>>,
}

/// Lights of a hard case stand still: the parameter moves them.
#[derive(Debug)]
enum NoPath {}

impl<'de> Deserialize<'de> for NoPath {
    fn deserialize<D: serde::Deserializer<'de>>(_: D) -> Result<Self, D::Error> {
        Err(serde::de::Error::custom("a light of a hard case has no path; the parameter moves it"))
    }
}

const FORGIVEN: &str = "factor by which a rounding error may grow against the baseline";

/// The most values of a parameter, and the most places of a case.
const MOST: usize = 1000;

/// The most normals, lights, rigs' centres and sixteens of texels over all cases of a file: every value of a parameter has its own.
const MOST_IN_ALL: usize = 1_000_000;

/// What a case holds of these.
fn held_by(case: &Case) -> usize {
    let light = |light: &Light<f64>| match light {
        Light::Environment(environment) => 1 + environment.map().size().0 * environment.map().size().1 / 16,
        Light::Polygon(polygon) => polygon.vertices().len(),
        _ => 1,
    };
    let rig = |rig: &Option<AnyRig>| match rig {
        Some(AnyRig::Rbf(Rbf { centers: Centers::Points(points), .. })) => points.len(),
        _ => 1,
    };
    let normals = case.places.iter().map(|place| place.normals.len()).sum::<usize>();
    normals + case.lights.iter().map(light).sum::<usize>() + case.rigs.iter().map(rig).sum::<usize>()
}

impl HardCases {
    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::load_with(path, &[])
    }

    /// With changes of the command line.
    pub fn load_with(path: &Path, changes: &[Override]) -> Result<Self, InputError> {
        let document = Document::read(path, changes)?;
        let cases = document.with_tree(|mut tree, source| read(&mut tree, source))?;
        Ok(Self { changes: changes.iter().map(|change| change.text().to_owned()).collect(), ..cases })
    }

    pub fn results_folder(&self) -> PathBuf {
        self.root.join("results").join(&self.name)
    }

    /// Every curve of a family, in the order of the results.
    pub fn curve_ids(&self, family: &Family) -> Vec<CurveId> {
        let mut ids = Vec::new();
        for (model, what) in family.models.iter().enumerate() {
            let orders: Vec<Option<usize>> =
                if what.direct { vec![None] } else { family.orders.iter().copied().map(Some).collect() };
            let gpu = self.gpu && family.has_twin(what);
            for order in orders {
                let asked = [false, true].into_iter().filter(|on_gpu| if *on_gpu { gpu } else { self.cpu });
                ids.extend(asked.map(|gpu| CurveId { model, order, gpu }));
            }
        }
        ids
    }

    /// What stands in a curve's column.
    pub fn column(family: &Family, id: &CurveId, column: &str) -> String {
        match column {
            "family" => family.name.clone(),
            "model" => family.models[id.model].name.clone(),
            "order" => id.order.map_or(String::new(), |order| order.to_string()),
            _ => if id.gpu { "gpu" } else { "cpu" }.to_owned(),
        }
    }

    /// The JSON schema of the file.
    pub fn schema() -> serde_json::Value {
        use crate::input::schema::{
            above, default, described, document, either, exactly, list, named, number, one_key, optional, required,
            some, table, text, whole, word,
        };
        let formula = || either([number(), described(text(), "an expression of the parameter: \"=1 + t\"")]);
        let vector = || exactly(3, formula());
        // lights and rigs as elsewhere, but every number may be an expression
        let any_table = || serde_json::json!({ "type": "object" });
        let light = one_key(Light::KINDS.iter().map(|kind| (*kind, any_table())), [optional("name", text())]);
        let rig = || one_key(AnyRig::schemas(), []);
        let variant = one_key(AnyRig::KEYS.iter().map(|key| (*key, any_table())), []);
        let parameter = table([
            required("name", text()),
            optional("from", described(number(), "first of a geometric series, above 0")),
            optional("to", described(number(), "last of it")),
            optional("steps", whole(2, MOST as u64)),
            optional("values", described(some(number()), "in place of the series")),
            optional("also", described(list(number()), "values beside the series, 0 perhaps")),
        ]);
        let family = table([
            required("name", text()),
            optional("title", text()),
            required("parameter", parameter),
            optional(
                "rig",
                described(list(text()), "in place of the matrix's; `direct`, rigs, and words of light formulas"),
            ),
            optional("order", described(some(whole(1, MAX_ORDER as u64)), "in place of the matrix's")),
            optional("wrap", described(formula(), "a of the receivers' wrap lobe, 0 to 1; default 0")),
            required("box", table([optional("center", vector()), required("half", vector())])),
            optional("light", list(light)),
            required("point", some(table([required("position", vector()), optional("normals", list(vector()))]))),
            optional("move", described(vector(), "moves everything")),
            optional("variant", described(named(variant), "rigs of this family alone")),
        ]);
        let words = || either([text(), serde_json::json!({ "type": "integer" }), some(either([text(), whole(1, 6)]))]);
        let choice = table(CHOICES.map(|name| optional(name, words())));
        let threshold = table([
            optional("where", choice),
            required("metric", word(COLUMNS.iter().map(|c| c.0))),
            optional("max", described(number(), "holds at every value of the parameter")),
            optional("reaches", described(number(), "the largest value is at least this")),
        ]);
        let matrix = table([
            required("rig", some(text())),
            required("order", some(whole(1, MAX_ORDER as u64))),
            required("backend", some(word(["cpu", "gpu"]))),
        ]);
        document(
            "rigbench hard cases",
            table([
                required("schema_version", whole(1, 1)),
                required("name", text()),
                optional("title", text()),
                required("kind", word([KIND])),
                required("matrix", matrix),
                optional("rig", named(rig())),
                required("family", some(family)),
                optional("threshold", list(threshold)),
                optional("check", table([optional("error", default(described(above(1.0), FORGIVEN), 4.0))])),
            ]),
        )
    }
}

fn deserialize<V: DeserializeOwned>(value: Spanned<DeValue<'_>>, source: &Source) -> Result<V, InputError> {
    V::deserialize(toml::de::ValueDeserializer::from(value)).map_err(|e| source.toml_error(&e))
}

/// Rigs by name, with their places.
type Rigs = Vec<(String, AnyRig)>;

fn read(tree: &mut Spanned<DeTable<'_>>, source: &Source) -> Result<HardCases, InputError> {
    let table = tree.get_mut();
    let mut rigs: Rigs = Vec::new();
    for (name, value) in take_table(table, "rig", source)? {
        if Model::of_lights(name.get_ref()).is_some() {
            let message = format!("`{}` is built in; give the rig another name", name.get_ref());
            return Err(source.error(name.span(), message));
        }
        let span = value.span();
        let rig = deserialize::<RigFile>(value, source)?.resolve(source, span, None)?;
        rigs.push((name.into_inner().into_owned(), rig));
    }
    let families = match table.remove("family") {
        None => return Err(source.error(0..0, "no family; give at least one table [[family]]")),
        Some(value) => {
            let span = value.span();
            match value.into_inner() {
                DeValue::Array(list) => list,
                other => {
                    let message = format!("invalid type: {}, expected tables [[family]]", other.type_str());
                    return Err(source.error(span, message));
                }
            }
        }
    };
    let rest = Spanned::new(tree.span(), std::mem::take(tree.get_mut()));
    let head: FileHead = FileHead::deserialize(toml::Deserializer::from(rest)).map_err(|e| source.toml_error(&e))?;
    if *head.schema_version.get_ref() != 1 {
        let message = format!("unknown schema_version {}; this program reads 1", head.schema_version.get_ref());
        return Err(source.error(head.schema_version.span(), message));
    }
    let name = crate::experiment::folder_name(source, &head.name)?;
    let matrix = &head.matrix;
    let orders = read_orders(&matrix.order, source)?;
    let mut backends = [false; 2];
    for backend in matrix.backend.get_ref() {
        match backend.get_ref().as_str() {
            "cpu" => backends[0] = true,
            "gpu" => backends[1] = true,
            word => return Err(source.unknown_word(backend.span(), "backend", word, ["cpu", "gpu"])),
        }
    }
    let empty = [(matrix.rig.get_ref().is_empty(), matrix.rig.span()), (backends == [false; 2], matrix.backend.span())];
    if let Some((_, span)) = empty.into_iter().find(|(empty, _)| *empty) {
        return Err(source.error(span, "an empty list"));
    }
    let all_models = chosen(matrix.rig.get_ref(), &rigs, source)?;
    let mut read_families: Vec<Family> = Vec::new();
    for value in families {
        let family = read_family(value, &all_models, &orders, &rigs, source, &read_families)?;
        read_families.push(family);
    }
    if read_families.is_empty() {
        return Err(source.error(0..0, "no family; give at least one table [[family]]"));
    }
    let mut cases = HardCases {
        path: source.path.clone(),
        root: root(source.folder()).unwrap_or_else(|| source.folder().to_owned()),
        title: if head.title.is_empty() { name.clone() } else { head.title.clone() },
        name,
        orders,
        cpu: backends[0],
        gpu: backends[1],
        families: read_families,
        bounds: Vec::new(),
        check: CheckSettings::default(),
        changes: Vec::new(),
    };
    if let Some(error) = head.check.and_then(|check| check.error) {
        cases.check.error = error.get_ref().0;
        if cases.check.error <= 1.0 {
            let message = format!("error {}: a factor above 1, for example 4", cases.check.error);
            return Err(source.error(error.span(), message));
        }
    }
    cases.bounds = head.threshold.iter().map(|bound| read_bound(bound, &cases, source)).collect::<Result<_, _>>()?;
    Ok(cases)
}

fn read_orders(list: &Spanned<Vec<Spanned<i64>>>, source: &Source) -> Result<Vec<usize>, InputError> {
    let mut orders = Vec::new();
    for order in list.get_ref() {
        match usize::try_from(*order.get_ref()) {
            Ok(n @ 1..=MAX_ORDER) if orders.contains(&n) => {
                return Err(source.error(order.span(), format!("order {n} twice in one list")));
            }
            Ok(n @ 1..=MAX_ORDER) => orders.push(n),
            _ => {
                let message = format!("order {}: an order is a whole number from 1 to {MAX_ORDER}", order.get_ref());
                return Err(source.error(order.span(), message));
            }
        }
    }
    match orders.is_empty() {
        true => Err(source.error(list.span(), "an empty list")),
        false => Ok(orders),
    }
}

/// Models by their names.
fn chosen(names: &[Spanned<String>], rigs: &Rigs, source: &Source) -> Result<Vec<Model>, InputError> {
    let mut models: Vec<Model> = Vec::new();
    for name in names {
        let word = name.get_ref();
        if models.iter().any(|model| model.name == *word) {
            return Err(source.error(name.span(), format!("`{word}` twice in one list")));
        }
        models.push(match Model::of_lights(word) {
            Some(model) => model,
            None if rigs.iter().any(|(known, _)| known == word) => Model::rig(word),
            None => {
                let rigs = rigs.iter().map(|(name, _)| name.clone());
                let all: Vec<String> = formula_words().chain([DIRECT]).map(str::to_owned).chain(rigs).collect();
                let known = all.iter().map(String::as_str);
                return Err(source.unknown_word(name.span(), "rig", word, known));
            }
        });
    }
    Ok(models)
}

fn read_family(
    value: Spanned<DeValue<'_>>,
    all: &[Model],
    orders: &[usize],
    rigs: &Rigs,
    source: &Source,
    before: &[Family],
) -> Result<Family, InputError> {
    let span = value.span();
    let DeValue::Table(mut rest) = value.into_inner() else {
        return Err(source.error(span, "a family is a table [[family]]"));
    };
    let mut head = DeTable::new();
    for key in ["name", "title", "parameter", "rig", "order"] {
        if let Some((key, value)) = rest.remove_entry(key) {
            head.insert(key, value);
        }
    }
    let head: FamilyHead = deserialize(Spanned::new(span.clone(), DeValue::Table(head)), source)?;
    let name = head.name.get_ref().clone();
    if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c)) {
        return Err(source.error(head.name.span(), format!("family `{name}`: letters, digits, `-` and `_`")));
    }
    if before.iter().any(|family| family.name == name) {
        return Err(source.error(head.name.span(), format!("a second family `{name}`")));
    }
    let mut models = match &head.rig {
        None => all.to_vec(),
        Some(list) => chosen(list.get_ref(), rigs, source)?,
    };
    let of_all = models.len();
    let mut cases = Vec::new();
    let mut held: usize = before.iter().flat_map(|family| &family.cases).map(held_by).sum();
    for t in values(&head.parameter, source)? {
        let (case, variants) = read_case(&rest, span.clone(), t, source)?;
        if cases.is_empty() {
            for (name, _) in &variants {
                if Model::of_lights(name).is_some() || models.iter().any(|model| model.name == *name) {
                    return Err(source.error(span, format!("variant `{name}` has the name of another model")));
                }
                models.push(Model::rig(name));
            }
        }
        let mut of_case: Vec<Option<AnyRig>> = models[..of_all]
            .iter()
            .map(|model| rigs.iter().find(|(name, _)| *name == model.name).map(|(_, rig)| rig.clone()))
            .collect();
        of_case.extend(variants.into_iter().map(|(_, rig)| Some(rig)));
        let refused = models
            .iter()
            .filter(|_| case.wrap != 0.0)
            .find_map(|model| model.formula.without_wrap(&case.lights).map(|(shape, _)| (&model.name, shape)));
        if let Some((word, shape)) = refused {
            let message =
                format!("the formula `{word}` of a {shape} knows the clamped cosine alone; this family wraps");
            return Err(source.error(span, message));
        }
        let case = Case { rigs: of_case, ..case };
        held += held_by(&case);
        if held > MOST_IN_ALL {
            let message =
                format!("more than {MOST_IN_ALL} normals, lights and centres over the values of all parameters");
            return Err(source.error(span, message));
        }
        cases.push(case);
    }
    if models.is_empty() {
        return Err(source.error(span, "a family without a model"));
    }
    Ok(Family {
        title: if head.title.is_empty() { name.clone() } else { head.title },
        name,
        parameter: head.parameter.into_inner().name,
        models,
        orders: match &head.order {
            None => orders.to_vec(),
            Some(list) => read_orders(list, source)?,
        },
        cases,
    })
}

impl Family {
    /// Whether the GPU can evaluate a model: rigs always; lights point by point where every shape has a twin for the lobe.
    fn has_twin(&self, model: &Model) -> bool {
        !model.direct
            || self.cases.iter().all(|case| {
                let lobe = Lobe::<f32>::new(case.wrap);
                case.lights.iter().all(|light| shader_kinds(&lobe).any(|kind| kind == light.kind_name()))
            })
    }
}

/// The values of the parameter: a geometric series, or a list, and what stands beside it.
fn values(parameter: &Spanned<ParameterFile>, source: &Source) -> Result<Vec<f64>, InputError> {
    let file = parameter.get_ref();
    let mut values: Vec<f64> = match (&file.values, &file.from, &file.to, &file.steps) {
        (Some(list), None, None, None) => list.get_ref().iter().map(|v| v.0).collect(),
        (None, Some(from), Some(to), Some(steps)) => {
            for end in [from, to] {
                if end.get_ref().0 <= 0.0 {
                    return Err(source.error(end.span(), "an end of a geometric series is above 0"));
                }
            }
            let count = *steps.get_ref();
            if !(2..=MOST as i64).contains(&count) {
                return Err(source.error(steps.span(), format!("{count} steps; allowed: 2 to {MOST}")));
            }
            let (from, to) = (from.get_ref().0, to.get_ref().0);
            let share = |k: i64| k as f64 / (count - 1) as f64;
            (0..count).map(|k| (from.ln() + (to / from).ln() * share(k)).exp()).collect()
        }
        _ => return Err(source.error(parameter.span(), "give `values`, or `from`, `to` and `steps`")),
    };
    values.extend(file.also.iter().map(|v| v.0));
    if values.is_empty() || values.len() > MOST {
        return Err(source.error(parameter.span(), format!("{} values; allowed: 1 to {MOST}", values.len())));
    }
    Ok(values)
}

/// The normals at every place: the axes both ways and the corners of a cube.
fn usual_normals() -> Vec<DVec3> {
    let mut normals: Vec<DVec3> = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]).collect();
    normals.extend((0..8).map(|k| DVec3::from_array([0, 1, 2].map(|a| f64::from((k >> a & 1) * 2 - 1))).normalize()));
    normals
}

fn read_case(
    rest: &DeTable<'_>,
    span: Range<usize>,
    t: f64,
    source: &Source,
) -> Result<(Case, Vec<(String, AnyRig)>), InputError> {
    let mut texts = Vec::new();
    for value in rest.values() {
        evaluate(value, t, source, &mut texts)?;
    }
    let mut numbers = texts.iter();
    let mut table: DeTable<'_> = rest.clone();
    for (_, value) in table.iter_mut() {
        substitute(value, &mut numbers);
    }
    let file: CaseFile = deserialize(Spanned::new(span, DeValue::Table(table)), source)?;
    let half = file.bounds.get_ref().half.get_ref().vector();
    if half.min_element() < 0.0 {
        return Err(source.error(file.bounds.get_ref().half.span(), format!("half extents {half}; none is negative")));
    }
    let center = file.bounds.get_ref().center.map_or(DVec3::ZERO, Finite3::vector);
    let offset = file.moved.map_or(DVec3::ZERO, Finite3::vector);
    let mut lights = Vec::new();
    for light in &file.light {
        lights.push(light.get_ref().resolve(source, light.span())?.translated(offset));
    }
    let places = file.point.get_ref();
    if places.is_empty() || places.len() > MOST {
        return Err(source.error(file.point.span(), format!("{} points; allowed: 1 to {MOST}", places.len())));
    }
    let mut read_places = Vec::new();
    for place in places {
        let mut normals = usual_normals();
        for normal in &place.normals {
            let unit = normal.get_ref().vector().try_normalize();
            normals.push(unit.ok_or_else(|| source.error(normal.span(), "a normal without a length"))?);
        }
        read_places.push(Place { position: place.position.vector() + offset, normals });
    }
    let wrap = file.wrap.as_ref().map_or(0.0, |wrap| wrap.get_ref().0);
    if let Some(given) = file.wrap.as_ref().filter(|_| !(0.0..=1.0).contains(&wrap)) {
        return Err(source.error(given.span(), format!("wrap {wrap}; a wrap lies in 0 to 1")));
    }
    let mut variants = Vec::new();
    for (name, rig) in &file.variant {
        variants.push((name.get_ref().clone(), rig.get_ref().resolve(source, rig.span(), None)?));
    }
    let bounds = OrientedBox { half: half.to_array(), ..OrientedBox::aligned(center + offset, center + offset) };
    Ok((Case { t, lights, bounds, wrap, places: read_places, rigs: Vec::new() }, variants))
}

/// The expressions of a tree in its order, as TOML numbers at `t`.
fn evaluate(value: &Spanned<DeValue<'_>>, t: f64, source: &Source, texts: &mut Vec<String>) -> Result<(), InputError> {
    match value.get_ref() {
        DeValue::String(text) => {
            if let Some(expression) = text.strip_prefix('=') {
                let expression = Expression::parse(expression).map_err(|why| source.error(value.span(), why))?;
                let number = expression.value(t);
                if !number.is_finite() {
                    let message = format!("`{text}` is {number} at t = {t:?}; it must be a finite number");
                    return Err(source.error(value.span(), message));
                }
                texts.push(format!("v = {number:?}"));
            }
        }
        DeValue::Array(list) => list.iter().try_for_each(|item| evaluate(item, t, source, texts))?,
        DeValue::Table(table) => table.values().try_for_each(|item| evaluate(item, t, source, texts))?,
        _ => {}
    }
    Ok(())
}

/// Puts the numbers in place of the expressions.
fn substitute<'t>(value: &mut Spanned<DeValue<'t>>, numbers: &mut std::slice::Iter<'t, String>) {
    match value.get_mut() {
        DeValue::String(text) if text.starts_with('=') => {
            let number = numbers.next().and_then(|text| DeTable::parse(text).ok());
            if let Some(number) = number.and_then(|table| table.into_inner().remove("v")) {
                *value = Spanned::new(value.span(), number.into_inner());
            }
        }
        DeValue::Array(list) => list.iter_mut().for_each(|item| substitute(item, numbers)),
        DeValue::Table(table) => table.iter_mut().for_each(|(_, item)| substitute(item, numbers)),
        _ => {}
    }
}

fn read_bound(file: &Spanned<BoundFile>, cases: &HardCases, source: &Source) -> Result<Bound, InputError> {
    let (span, file) = (file.span(), file.get_ref());
    let known = |column: &str| -> Vec<String> {
        let mut all: Vec<String> = Vec::new();
        for family in &cases.families {
            for id in cases.curve_ids(family) {
                let word = HardCases::column(family, &id, column);
                if !word.is_empty() && !all.contains(&word) {
                    all.push(word);
                }
            }
        }
        all
    };
    let mut wanted = Vec::new();
    for (key, values) in &file.wanted {
        let column = key.get_ref();
        if !CHOICES.contains(&column.as_str()) {
            return Err(source.unknown_word(key.span(), "column", column, CHOICES));
        }
        let list: Vec<AxisValue> = match values.get_ref() {
            AxisValues::One(value) => vec![value.clone()],
            AxisValues::Many(list) => list.iter().map(|v| v.get_ref().clone()).collect(),
        };
        let known = known(column);
        let words: Vec<String> = list.iter().map(ToString::to_string).collect();
        if let Some(word) = words.iter().find(|word| !known.contains(word)) {
            return Err(source.unknown_word(values.span(), column, word, known.iter().map(String::as_str)));
        }
        wanted.push((column.clone(), words));
    }
    let names = COLUMNS.map(|(name, _)| name);
    if !names.contains(&file.metric.get_ref().as_str()) {
        return Err(source.unknown_word(file.metric.span(), "metric", file.metric.get_ref(), names));
    }
    if file.max.is_none() && file.reaches.is_none() {
        return Err(source.error(span, "a threshold needs `max` or `reaches`"));
    }
    let bound = Bound {
        wanted,
        metric: file.metric.get_ref().clone(),
        max: file.max.map(|v| v.0),
        reaches: file.reaches.map(|v| v.0),
        line: source.error(span.clone(), "").place.map_or(0, |(line, _)| line),
    };
    let any = cases.families.iter().any(|family| cases.curve_ids(family).iter().any(|id| bound.matches(family, id)));
    if any { Ok(bound) } else { Err(source.error(span, "this threshold matches no curve")) }
}

impl Bound {
    pub fn matches(&self, family: &Family, id: &CurveId) -> bool {
        self.wanted.iter().all(|(column, words)| words.contains(&HardCases::column(family, id, column)))
    }

    /// As [`Bound::matches`], of a row of results.
    pub fn selects<'r>(&self, column: impl Fn(&str) -> &'r str) -> bool {
        self.wanted.iter().all(|(name, words)| words.iter().any(|word| word == column(name)))
    }
}
