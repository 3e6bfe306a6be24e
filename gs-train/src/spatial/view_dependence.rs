//! How much of what is still wrong with a scene's colours depends on where they are seen from: what calls for harmonics.
//!
//! In view v, Gaussian i is pulled towards another colour by r_iv = ∂L/∂(its coefficient of degree 0) under L2: its residual there, weighted by what
//! it shows. Were that a function of the viewing direction d whose part of degree l is random and isotropic, residuals of two views would
//! correlate with P_l(d_v·d_w), the Legendre polynomial, by the addition theorem of spherical harmonics. So, with H taking away each Gaussian's mean,
//! which the coefficient of degree 0 can learn, and K_vw = P_l(d_v·d_w), its V residuals have
//!
//! E[rᵀH K H r] = σ_l² tr((HKH)²) + σ² tr(HKH) and E[rᵀH r] = σ_l² tr(HKH) + σ² (V − 1),
//!
//! where σ² is what nothing explains. The share s = σ_l² tr(HKH) / E[rᵀH r] follows by the method of moments, over all Gaussians together: 1 where
//! degree l explains all of how residuals vary between views, 0 where it does as well as chance. *Source:* the moment estimator of variance
//! components (Henderson 1953), with the kernel of degree l.

use glam::Vec3;

/// Residuals of a sample of Gaussians, view by view.
#[derive(Debug, Clone, Default)]
pub(super) struct Residuals {
    /// By Gaussian: each view that shows it, with the direction from the camera to it and the residual.
    of: Vec<Vec<(Vec3, Vec3)>>,
}

/// How the residuals of Gaussians vary between views.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ViewDependence {
    /// The share of it that harmonics of one degree explain; about 0 by chance, sometimes a little below, and about 1 at most.
    pub share: f32,
    /// Gaussians that were seen in enough views.
    pub gaussians: usize,
}

impl Residuals {
    /// Of so many Gaussians, none seen yet.
    pub(super) fn of(gaussians: usize) -> Self {
        Self { of: vec![Vec::new(); gaussians] }
    }

    /// Adds what one view shows: by Gaussian, the unit direction from the camera to it and its residual, 0 where it does not show.
    pub(super) fn add(&mut self, seen: impl Iterator<Item = (Vec3, Vec3)>) {
        for (views, (direction, residual)) in self.of.iter_mut().zip(seen) {
            if residual != Vec3::ZERO && residual.is_finite() && direction.is_finite() {
                views.push((direction, residual));
            }
        }
    }

    /// What harmonics of this degree, 1 to 3, explain.
    pub(super) fn explained_by(&self, degree: u8) -> ViewDependence {
        let (mut above_chance, mut at_most, mut gaussians) = (0.0f64, 0.0f64, 0);
        for views in self.of.iter().filter(|views| views.len() >= FEWEST_VIEWS) {
            let Some((above, most)) = moments(views, degree) else { continue };
            above_chance += above;
            at_most += most;
            gaussians += 1;
        }
        let share = if at_most > 0.0 { (above_chance / at_most) as f32 } else { 0.0 };
        ViewDependence { share, gaussians }
    }
}

/// Fewer views of a Gaussian say nothing about where it is seen from.
const FEWEST_VIEWS: usize = 3;

/// Of one Gaussian: rᵀHKHr less what it would be by chance, and what that would be if the degree explained everything.
fn moments(views: &[(Vec3, Vec3)], degree: u8) -> Option<(f64, f64)> {
    let count = views.len() as f64;
    let mean = views.iter().map(|view| view.1).sum::<Vec3>() / count as f32;
    let kernel: Vec<Vec<f64>> =
        views.iter().map(|v| views.iter().map(|w| legendre(degree, f64::from(v.0.dot(w.0)))).collect()).collect();
    let row_means: Vec<f64> = kernel.iter().map(|row| row.iter().sum::<f64>() / count).collect();
    let all = row_means.iter().sum::<f64>() / count;
    let (mut form, mut trace, mut square, mut energy) = (0.0, 0.0, 0.0, 0.0);
    for (v, row) in kernel.iter().enumerate() {
        let centered_v = (views[v].1 - mean).as_dvec3();
        energy += centered_v.length_squared();
        for (w, &value) in row.iter().enumerate() {
            let value = value - row_means[v] - row_means[w] + all;
            form += value * centered_v.dot((views[w].1 - mean).as_dvec3());
            square += value * value;
            trace += if v == w { value } else { 0.0 };
        }
    }
    // All from one direction: no degree could tell.
    let chance = trace / (count - 1.0);
    let most = if trace > 1e-9 { square / trace } else { chance };
    (most > chance * (1.0 + 1e-6)).then_some((form - energy * chance, energy * (most - chance)))
}

/// P_l(x) for l of 1 to 3.
fn legendre(degree: u8, x: f64) -> f64 {
    match degree {
        1 => x,
        2 => 1.5 * x * x - 0.5,
        _ => 2.5 * x * x * x - 1.5 * x,
    }
}

#[cfg(test)]
mod tests {
    use gs_core::sh;
    use gs_density::Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// 400 Gaussians seen in eight views each; their residuals by direction and chance.
    fn residuals(mut of: impl FnMut(usize, Vec3, &mut Rng) -> Vec3) -> Residuals {
        let mut rng = Rng::seed_from_u64(7);
        let mut residuals = Residuals::of(400);
        for _ in 0..8 {
            let seen: Vec<(Vec3, Vec3)> = (0..400)
                .map(|index| {
                    // From above, as most objects are photographed.
                    let across = Vec3::new(noise(&mut rng), noise(&mut rng), 1.0 + noise(&mut rng)).normalize();
                    (across, of(index, across, &mut rng))
                })
                .collect();
            residuals.add(seen.into_iter());
        }
        residuals
    }

    fn noise(rng: &mut Rng) -> f32 {
        rng.random_range(-1.0f32..1.0)
    }

    fn colour(rng: &mut Rng) -> Vec3 {
        Vec3::new(noise(rng), noise(rng), noise(rng))
    }

    #[test]
    fn chance_and_colours_that_are_merely_wrong_explain_nothing() {
        let shares = |residuals: &Residuals| [1, 2, 3].map(|degree| residuals.explained_by(degree).share);
        let by_chance = shares(&residuals(|_, _, rng| colour(rng)));
        assert!(by_chance.iter().all(|share| share.abs() < 0.05), "{by_chance:?}");
        // Each Gaussian's colour is wrong by as much from everywhere.
        let wrong = shares(&residuals(|index, _, rng| 5.0 * Vec3::splat((index as f32).sin()) + colour(rng)));
        assert!(wrong.iter().all(|share| share.abs() < 0.05), "{wrong:?}");
        assert_eq!(Residuals::of(9).explained_by(1), ViewDependence::default());
    }

    #[test]
    fn what_depends_on_the_direction_is_found_by_its_degree() {
        for degree in 1..=3u8 {
            let coefficients: Vec<Vec3> = {
                let mut rng = Rng::seed_from_u64(9);
                (0..400 * 16).map(|_| colour(&mut rng)).collect()
            };
            let found = residuals(|index, direction, _| {
                let y = sh::basis(degree, direction);
                let band = usize::from(degree).pow(2)..(usize::from(degree) + 1).pow(2);
                band.map(|k| y[k] * coefficients[16 * index + k]).sum()
            });
            let shares = [1, 2, 3].map(|tried| found.explained_by(tried).share);
            let own = shares[usize::from(degree) - 1];
            assert!(own > 0.8, "degree {degree}: {shares:?}");
            assert!(shares.iter().all(|&share| share <= own), "degree {degree}: {shares:?}");
        }
    }

    #[test]
    fn a_share_is_found_among_noise() {
        let found = residuals(|index, direction, rng| {
            let of = [Vec3::X, Vec3::Y, Vec3::Z][index % 3];
            0.5 * Vec3::splat(direction.dot(of)) + 0.5 * colour(rng)
        });
        let share = found.explained_by(1).share;
        assert!((0.2..0.8).contains(&share), "{share}");
    }
}
