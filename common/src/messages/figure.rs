//! Figures of a mission: one row of a table makes the key of a summary, the column of sweeps, the row of the printed
//! report and the line of the book.
//!
//! The tables are left to the crates that know what their figures are computed from.

use std::borrow::Cow;

use crate::nodes::energy::NodeEnergyUse;

/// What must be known of a recorded mission to compute a figure again, each with all that stands before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FigureSource {
    /// Scenario and trace.
    Trace,
    /// Which of the served sensor nodes have answered.
    Answers,
    /// The links of the flights, and so the ledger of each sensor node.
    Links,
    /// The run itself, such as its times: it cannot be computed again.
    Run,
}

/// The kind of a figure's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FigureKind {
    /// A real number.
    Real,
    /// A whole number.
    Count,
    /// A wall-clock time, which is not reproducible.
    WallClock,
    /// No number: a text, or a table of figures of its own.
    Other,
}

/// The range of a quantity and of its mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Support {
    /// Any number.
    Real,
    /// A number that is not negative.
    NonNegative,
    /// A fraction, from 0 to 1.
    Fraction,
    /// The difference of two fractions, from −1 to 1.
    FractionDifference,
}

impl Support {
    /// The range of the difference of two such quantities.
    pub fn of_difference(self) -> Self {
        match self {
            Self::Fraction => Self::FractionDifference,
            Self::Real | Self::NonNegative | Self::FractionDifference => Self::Real,
        }
    }

    /// Its least and its greatest value.
    pub fn ends(self) -> [f64; 2] {
        match self {
            Self::Real => [f64::NEG_INFINITY, f64::INFINITY],
            Self::NonNegative => [0.0, f64::INFINITY],
            Self::Fraction => [0.0, 1.0],
            Self::FractionDifference => [-1.0, 1.0],
        }
    }
}

/// The value of a key of a summary.
pub trait FigureValue: Sized {
    /// It as a number; NaN if it has none.
    fn number(&self) -> f64 {
        f64::NAN
    }

    /// It as a whole number, to the last digit; `None` if it is none.
    fn count(&self) -> Option<u64> {
        None
    }

    /// Replaces it by what a mission that was flown again says.
    fn recompute(&mut self, again: Self) {
        *self = again;
    }
}

impl FigureValue for f64 {
    fn number(&self) -> f64 {
        *self
    }
}

impl FigureValue for u64 {
    fn number(&self) -> f64 {
        *self as f64 // exact below 2^53
    }

    fn count(&self) -> Option<u64> {
        Some(*self)
    }
}

impl FigureValue for usize {
    fn number(&self) -> f64 {
        *self as f64
    }

    fn count(&self) -> Option<u64> {
        u64::try_from(*self).ok()
    }
}

impl FigureValue for bool {
    fn number(&self) -> f64 {
        f64::from(u8::from(*self))
    }
}

impl<V: FigureValue> FigureValue for Option<V> {
    fn number(&self) -> f64 {
        self.as_ref().map_or(f64::NAN, V::number)
    }

    fn count(&self) -> Option<u64> {
        self.as_ref().and_then(V::count)
    }

    fn recompute(&mut self, again: Self) {
        match (self.as_mut(), again) {
            (Some(value), Some(again)) => value.recompute(again),
            (_, again) => *self = again,
        }
    }
}

impl FigureValue for String {}
impl FigureValue for Cow<'static, str> {}
impl<T> FigureValue for Vec<T> {}
impl FigureValue for NodeEnergyUse {}

/// A table of figures, which is the type of a summary.
pub trait FigureTable: 'static {
    /// What the figures are computed from.
    type Sums<'a>;
    /// The figures that are counted slot by slot.
    type Counts;
}

/// A row of a printed report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportRow {
    /// What it says.
    pub heading: &'static str,
    /// The value, with its unit.
    pub value: String,
}

/// How a printed report shows a figure.
#[derive(Debug)]
pub enum Printed<T> {
    /// Not at all.
    Hidden,
    /// As a number; not where it has none.
    Number(fn(f64) -> String),
    /// As a whole number; not where it has none.
    Count(fn(u64) -> String),
    /// As a text that may name other figures of the summary; not where it is `None`.
    Text(fn(&T) -> Option<String>),
    /// In rows of its own.
    Rows(fn(&T) -> Vec<ReportRow>),
}

/// The value of a column, from the sums and counts of a mission.
pub type OfColumn<T> = for<'a> fn(&<T as FigureTable>::Sums<'a>, &<T as FigureTable>::Counts) -> f64;

/// What there is to know of a figure.
#[derive(Debug)]
pub struct Figure<T: FigureTable> {
    /// The name of its key, and of its column in the results of sweeps.
    pub name: &'static str,
    /// Its definition, for the book.
    pub definition: &'static str,
    /// Its description in plots and tables, without the unit.
    pub label: &'static str,
    /// Its description in the printed report; empty where that is the label.
    pub heading: &'static str,
    /// Its unit; empty for a fraction or an index.
    pub unit: &'static str,
    /// The kind of its values.
    pub kind: FigureKind,
    /// The range of its values that a confidence interval respects.
    pub support: Support,
    /// What must be known to compute it again.
    pub source: FigureSource,
    /// How the printed report shows it.
    pub report: Printed<T>,
    /// Its value in a summary; `None` if it is no key.
    pub of_key: Option<fn(&T) -> f64>,
    /// The same as a whole number; `None` if it is no key.
    pub count_of_key: Option<fn(&T) -> Option<u64>>,
    /// Its value in the results of sweeps, NaN if a mission has none; `None` if it is no column.
    pub of_column: Option<OfColumn<T>>,
}

impl<T: FigureTable> Figure<T> {
    /// A real number that is not negative, of which nothing else is said.
    pub const REAL: Self = Self {
        name: "",
        definition: "",
        label: "",
        heading: "",
        unit: "",
        kind: FigureKind::Real,
        support: Support::NonNegative,
        source: FigureSource::Trace,
        report: Printed::Hidden,
        of_key: None,
        count_of_key: None,
        of_column: None,
    };

    /// Its description with its unit.
    pub fn label_with_unit(&self) -> String {
        let Self { label, unit, .. } = self;
        if unit.is_empty() { (*label).to_owned() } else { format!("{label} [{unit}]") }
    }

    /// What the printed report says of it.
    pub fn rows(&self, summary: &T) -> Vec<ReportRow> {
        let value = match self.report {
            Printed::Hidden => None,
            Printed::Number(text) => {
                self.of_key.map(|of_key| of_key(summary)).filter(|number| !number.is_nan()).map(text)
            }
            Printed::Count(text) => self.count_of_key.and_then(|count| count(summary)).map(text),
            Printed::Text(text) => text(summary),
            Printed::Rows(rows) => return rows(summary),
        };
        let heading = if self.heading.is_empty() { self.label } else { self.heading };
        value.map(|value| ReportRow { heading, value }).into_iter().collect()
    }
}

/// Declares a table of figures: the struct of a summary, the sums that are counted slot by slot, and the columns of
/// sweeps.
///
/// A row is the definition, the name, the column in parentheses if there is one, the type of the key if there is one,
/// what else is said of the [`Figure`], and how it is computed: from the sums, or by `each` slot.
///
/// ```
/// use skysink_common::figure::{Figure, FigureSource, Printed};
/// use skysink_common::figures;
///
/// /// What the figures are computed from.
/// pub struct Sums<'a>(&'a [u64]);
/// /// A slot in which so many sensor nodes are served.
/// pub struct Slot<'a>(&'a u64);
///
/// const REAL: Figure<Results> = Figure::REAL;
///
/// figures! {
///     /// The results.
///     #[derive(Debug, Default, PartialEq)]
///     pub struct Results of Sums;
///     /// The counts.
///     #[derive(Debug, Default)]
///     pub struct Counts of Slot;
///     /// The columns.
///     #[derive(Debug, Clone, Copy, PartialEq)]
///     pub enum Column;
///
///     /// Services.
///     served: u64 = REAL { label: "services", report: Printed::Number(|served| served.to_string()) },
///         each |served, slot| *served += slot.0;
///     /// Largest number of services in a slot.
///     most (Most) = REAL { label: "most services", source: FigureSource::Links },
///         |sums| *sums.0.iter().max().unwrap();
///     /// The mean.
///     mean (Mean): f64 = REAL { label: "services per slot" },
///         |sums| sums.0.iter().sum::<u64>() as f64 / sums.0.len() as f64;
/// }
///
/// let slots = [1, 5];
/// let mut counts = Counts::default();
/// slots.iter().for_each(|served| counts.add(&Slot(served)));
/// let sums = Sums(&slots);
/// let results = Results::of(&sums, &counts);
/// assert_eq!(results, Results { served: 6, mean: 3.0 });
/// assert_eq!(Column::ALL.map(|column| (column.figure().of_column.unwrap())(&sums, &counts)), [5.0, 3.0]);
/// assert_eq!(Results::FIGURES[0].rows(&results)[0].value, "6");
/// ```
#[macro_export]
macro_rules! figures {
    (
        $(#[$table_attribute:meta])*
        pub struct $table:ident of $sums:ident;
        $(#[$counts_attribute:meta])*
        pub struct $counts:ident of $slot:ident;
        $(#[$columns_attribute:meta])*
        pub enum $columns:ident;
        $($rows:tt)*
    ) => {
        $crate::figures! {
            @row [$table $sums $counts $slot $columns]
            [$(#[$table_attribute])*] [$(#[$counts_attribute])*] [$(#[$columns_attribute])*]
            [] [] [] []
            $($rows)*
        }
    };
    // A key that is counted slot by slot.
    (
        @row [$table:ident $sums:ident $counts:ident $slot:ident $columns:ident]
        $table_attributes:tt $counts_attributes:tt $columns_attributes:tt
        [$($keys:tt)*] [$($counted:tt)*] [$($figures:tt)*] [$($variants:tt)*]
        $(#[doc = $definition:literal])+ $(#[serde($($serde:tt)*)])?
        $name:ident $(($variant:ident))? : $type:ty = $kind:ident { $($said:ident: $what:expr),* $(,)? },
        each $each:expr;
        $($rest:tt)*
    ) => {
        $crate::figures! {
            @row [$table $sums $counts $slot $columns]
            $table_attributes $counts_attributes $columns_attributes
            [$($keys)* {
                [$(#[doc = $definition])+ $(#[serde($($serde)*)])?] $name: $type, [counted $name]
            }]
            [$($counted)* { [$(#[doc = $definition])+] $name: $type, $each }]
            [$($figures)* $crate::figure::Figure {
                name: stringify!($name),
                definition: concat!($($definition),+),
                of_key: Some(|table: &$table| $crate::figure::FigureValue::number(&table.$name)),
                count_of_key: Some(|table: &$table| $crate::figure::FigureValue::count(&table.$name)),
                of_column: $crate::figures!(@column $sums $counts [$($variant)?] [counted $name]),
                $($said: $what,)*
                ..$kind
            },]
            [$($variants)* $({ $name $variant })?]
            $($rest)*
        }
    };
    // Another key.
    (
        @row [$table:ident $sums:ident $counts:ident $slot:ident $columns:ident]
        $table_attributes:tt $counts_attributes:tt $columns_attributes:tt
        [$($keys:tt)*] [$($counted:tt)*] [$($figures:tt)*] [$($variants:tt)*]
        $(#[doc = $definition:literal])+ $(#[serde($($serde:tt)*)])?
        $name:ident $(($variant:ident))? : $type:ty = $kind:ident { $($said:ident: $what:expr),* $(,)? }, $of:expr;
        $($rest:tt)*
    ) => {
        $crate::figures! {
            @row [$table $sums $counts $slot $columns]
            $table_attributes $counts_attributes $columns_attributes
            [$($keys)* { [$(#[doc = $definition])+ $(#[serde($($serde)*)])?] $name: $type, [of $of] }]
            [$($counted)*]
            [$($figures)* $crate::figure::Figure {
                name: stringify!($name),
                definition: concat!($($definition),+),
                of_key: Some(|table: &$table| $crate::figure::FigureValue::number(&table.$name)),
                count_of_key: Some(|table: &$table| $crate::figure::FigureValue::count(&table.$name)),
                of_column: $crate::figures!(@column $sums $counts [$($variant)?] [of $of]),
                $($said: $what,)*
                ..$kind
            },]
            [$($variants)* $({ $name $variant })?]
            $($rest)*
        }
    };
    // A column that is no key.
    (
        @row [$table:ident $sums:ident $counts:ident $slot:ident $columns:ident]
        $table_attributes:tt $counts_attributes:tt $columns_attributes:tt
        $keys:tt $counted:tt [$($figures:tt)*] [$($variants:tt)*]
        $(#[doc = $definition:literal])+
        $name:ident ($variant:ident) = $kind:ident { $($said:ident: $what:expr),* $(,)? }, $of:expr;
        $($rest:tt)*
    ) => {
        $crate::figures! {
            @row [$table $sums $counts $slot $columns]
            $table_attributes $counts_attributes $columns_attributes
            $keys $counted
            [$($figures)* $crate::figure::Figure {
                name: stringify!($name),
                definition: concat!($($definition),+),
                of_column: $crate::figures!(@column $sums $counts [$variant] [of $of]),
                $($said: $what,)*
                ..$kind
            },]
            [$($variants)* { $name $variant }]
            $($rest)*
        }
    };
    (@column $sums:ident $counts:ident [] $how:tt) => { None };
    (@column $sums:ident $counts:ident [$variant:ident] $how:tt) => {
        Some(|sums: &$sums<'_>, counts: &$counts| {
            $crate::figure::FigureValue::number(&$crate::figures!(@value $sums, _, $how, sums, counts))
        })
    };
    (@value $sums:ident, $type:ty, [counted $name:ident], $from:ident, $counts:ident) => { $counts.$name.clone() };
    (@value $sums:ident, $type:ty, [of $of:expr], $from:ident, $counts:ident) => {{
        let of: for<'a> fn(&$sums<'a>) -> $type = $of;
        of($from)
    }};
    // All rows are read.
    (
        @row [$table:ident $sums:ident $counts:ident $slot:ident $columns:ident]
        [$($table_attribute:tt)*] [$($counts_attribute:tt)*] [$($columns_attribute:tt)*]
        [$({ [$($key_attribute:tt)*] $key:ident: $key_type:ty, $how:tt })*]
        [$({ [$($counted_attribute:tt)*] $counted:ident: $counted_type:ty, $each:expr })*]
        [$($figures:tt)*]
        [$({ $column:ident $variant:ident })*]
    ) => {
        $($table_attribute)*
        pub struct $table { $($($key_attribute)* pub $key: $key_type,)* }

        impl $crate::figure::FigureTable for $table {
            type Sums<'a> = $sums<'a>;
            type Counts = $counts;
        }

        impl $table {
            /// All figures, in the order of the table.
            #[allow(unused_variables)] // a value is that of the sums or a count
            pub const FIGURES: &'static [$crate::figure::Figure<Self>] = &[$($figures)*];

            /// The figures of these sums and counts.
            #[must_use]
            pub fn of(sums: &$sums<'_>, counts: &$counts) -> Self {
                Self {
                    $($key: $crate::figures!(@value $sums, $key_type, $how, sums, counts),)*
                }
            }

            /// Replaces the figures that follow from what is `known` of the mission by those of `again`, which has
            /// flown it again.
            pub fn recompute(&mut self, again: Self, known: $crate::figure::FigureSource) {
                $(if Self::source(stringify!($key)) <= known {
                    $crate::figure::FigureValue::recompute(&mut self.$key, again.$key);
                })*
            }

            fn source(name: &str) -> $crate::figure::FigureSource {
                Self::FIGURES.iter().find(|figure| figure.name == name).expect("a row of the table").source
            }
        }

        $($counts_attribute)*
        pub struct $counts { $($($counted_attribute)* pub $counted: $counted_type,)* }

        impl $counts {
            /// Adds a slot.
            pub fn add(&mut self, slot: &$slot<'_>) {
                $({
                    let each: for<'a> fn(&mut $counted_type, &$slot<'a>) = $each;
                    each(&mut self.$counted, slot);
                })*
            }

            /// Counts from here on what only a run can know.
            pub fn restart(&mut self) {
                $(if $table::source(stringify!($counted)) == $crate::figure::FigureSource::Run {
                    self.$counted = Default::default();
                })*
            }
        }

        $($columns_attribute)*
        pub enum $columns { $(#[doc = concat!("`", stringify!($column), "`.")] $variant,)* }

        impl $columns {
            /// All columns, in the order of the table.
            pub const ALL: [Self; [$(stringify!($variant)),*].len()] = [$(Self::$variant),*];

            /// Its row.
            ///
            /// # Panics
            /// Never: each column has a row.
            pub fn figure(self) -> &'static $crate::figure::Figure<$table> {
                let mut columns = $table::FIGURES.iter().filter(|figure| figure.of_column.is_some());
                columns.nth(self as usize).expect("a row for each column")
            }
        }
    };
}
