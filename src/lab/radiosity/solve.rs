//! Solution of the radiosity equation B = E + ρ F B of a diffuse scene with finite elements. [Goral et al. 1984]

/// The radiosity equation of elements of equal area.
pub struct Equation {
    /// Emitted radiosity of each element.
    pub emission: Vec<f64>,
    /// Reflectance of each element.
    pub reflectance: Vec<f64>,
    /// Form factors, row by row.
    pub form_factors: Vec<f64>,
}

/// A solution, and the number of elements whose radiosity was computed or distributed.
pub struct Solution {
    pub radiosity: Vec<f64>,
    pub updates: u64,
}

impl Equation {
    fn row(&self, i: usize) -> &[f64] {
        let count = self.emission.len();
        &self.form_factors[i * count..(i + 1) * count]
    }

    /// Jacobi iteration: every element gathers from all others, until no radiosity changes by more than `tolerance`
    /// times the greatest emission.
    pub fn jacobi(&self, tolerance: f64) -> Solution {
        let enough = tolerance * self.emission.iter().fold(0.0, |most: f64, e| most.max(*e));
        let (mut radiosity, mut updates) = (self.emission.clone(), 0);
        loop {
            let gather = |i: usize| {
                let sum: f64 = self.row(i).iter().zip(&radiosity).map(|(f, b)| f * b).sum();
                self.emission[i] + self.reflectance[i] * sum
            };
            let next: Vec<f64> = (0..radiosity.len()).map(gather).collect();
            let change = next.iter().zip(&radiosity).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
            radiosity = next;
            updates += radiosity.len() as u64;
            if change <= enough {
                return Solution { radiosity, updates };
            }
        }
    }

    /// Southwell relaxation, or progressive refinement: the element with the most unshot radiosity shoots it to all
    /// others, until none has more than `tolerance` times the greatest emission. [Cohen et al. 1988]
    pub fn southwell(&self, tolerance: f64) -> Solution {
        let enough = tolerance * self.emission.iter().fold(0.0, |most: f64, e| most.max(*e));
        let (mut radiosity, mut unshot, mut updates) = (self.emission.clone(), self.emission.clone(), 0);
        loop {
            let most = (0..unshot.len()).max_by(|a, b| unshot[*a].total_cmp(&unshot[*b])).unwrap_or(0);
            if unshot[most] <= enough {
                return Solution { radiosity, updates };
            }
            let shot = std::mem::take(&mut unshot[most]);
            // F_ji = F_ij for equal areas.
            for (j, form_factor) in self.row(most).iter().enumerate() {
                let received = self.reflectance[j] * form_factor * shot;
                radiosity[j] += received;
                unshot[j] += received;
            }
            updates += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::form_factors::{closed_forms, elements};
    use super::*;

    /// In a furnace, every element has the radiosity E / (1 − ρ).
    #[test]
    fn a_furnace_has_a_known_radiosity() {
        let elements = elements(2);
        let equation = Equation {
            emission: vec![1.0; elements.len()],
            reflectance: vec![0.6; elements.len()],
            form_factors: closed_forms(&elements),
        };
        for solution in [equation.jacobi(1e-12), equation.southwell(1e-12)] {
            for radiosity in solution.radiosity {
                assert!((radiosity - 2.5).abs() < 1e-9, "{radiosity}");
            }
        }
    }
}
