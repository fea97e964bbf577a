//! A cone program that is written row by row, solved by Clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT};
use clarabel::solver::{DefaultSettings, DefaultSolution, DefaultSolver, IPSolver, SolverStatus};
use nalgebra::Vector2;

/// The program `min ½ uᵀ P u + cᵀ u` subject to `h − A u ∈ K`, with a diagonal `P`.
pub(crate) struct ConeProgram {
    /// The diagonal of `P`; empty for `P = 0`.
    pub quadratic: Vec<f64>,
    /// `c`.
    pub linear: Vec<f64>,
    /// The entries of `A`, by row, column and value.
    rows: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    /// `h`.
    offsets: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl ConeProgram {
    /// One of so many variables, without costs and constraints.
    pub fn new(variables: usize) -> Self {
        Self {
            quadratic: vec![0.0; variables],
            linear: vec![0.0; variables],
            rows: Vec::new(),
            columns: Vec::new(),
            values: Vec::new(),
            offsets: Vec::new(),
            cones: Vec::new(),
        }
    }

    /// Begins a cone, whose rows follow.
    pub fn cone(&mut self, cone: SupportedConeT<f64>) {
        self.cones.push(cone);
    }

    /// Adds the row `offset − Σ factor u_column` to the last cone.
    pub fn row(&mut self, offset: f64, factors: &[(usize, f64)]) {
        for &(column, factor) in factors {
            self.rows.push(self.offsets.len());
            self.columns.push(column);
            self.values.push(factor);
        }
        self.offsets.push(offset);
    }

    /// Adds the constraint `offset − Σ factor u_column ≥ 0`.
    pub fn at_least_0(&mut self, offset: f64, factors: &[(usize, f64)]) {
        match self.cones.last_mut() {
            Some(NonnegativeConeT(rows)) => *rows += 1,
            _ => self.cones.push(NonnegativeConeT(1)),
        }
        self.row(offset, factors);
    }

    /// Keeps a point within `radius`: it is at `from_centre` plus `unit` times the variables `x` and the one after it.
    pub fn stay_within(&mut self, radius: f64, from_centre: &Vector2<f64>, x: usize, unit: f64) {
        self.cone(SecondOrderConeT(3));
        self.row(radius, &[]);
        self.row(from_centre.x, &[(x, -unit)]);
        self.row(from_centre.y, &[(x + 1, -unit)]);
    }

    /// The solution to this tolerance; `None` unless Clarabel reports the status `Solved`.
    pub fn solve(self, tolerance: f64) -> Option<DefaultSolution<f64>> {
        let height = self.offsets.len();
        let width = self.linear.len();
        let constraints = CscMatrix::new_from_triplets(height, width, self.rows, self.columns, self.values);
        let diagonal: Vec<usize> = (0..self.quadratic.len()).collect();
        let quadratic = CscMatrix::new_from_triplets(width, width, diagonal.clone(), diagonal, self.quadratic);
        let settings =
            DefaultSettings { tol_feas: tolerance, tol_gap_abs: tolerance, tol_gap_rel: tolerance, ..settings() };
        let mut solver =
            DefaultSolver::new(&quadratic, &self.linear, &constraints, &self.offsets, &self.cones, settings)
                .expect("the shapes agree by construction");
        solver.solve();
        (solver.solution.status == SolverStatus::Solved).then_some(solver.solution)
    }
}

/// Repeatable results: one thread, no time limit, and all rows are kept, so that solutions have those of the program.
/// Equilibration does no harm where a solver is made anew for each program: results do not depend on earlier ones.
pub(crate) fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_threads: 1,
        direct_solve_method: "qdldl".to_owned(),
        time_limit: f64::INFINITY,
        presolve_enable: false,
        ..DefaultSettings::default()
    }
}
