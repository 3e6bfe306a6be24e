//! How much of what is still wrong with a scene's colours depends on where they are seen from: what calls for harmonics.
//!
//! In view v, Gaussian i is pulled towards another colour by ∂L/∂(its coefficient of degree 0) under L2. Divided by what it shows there, Σ Tα over the
//! pixels, that is its residual r_iv: the mean of what is wrong with the pixels that show it. (Undivided, a colour that is wrong by as much from
//! everywhere would seem to depend on the view, as what is shown does.) Were that a function of the viewing direction d whose part of degree l is random and isotropic, residuals of two views would
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
    /// By Gaussian: each view that shows it.
    of: Vec<Vec<Seen>>,
}

/// One Gaussian in one view.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// From the camera to it, of unit length.
    pub(super) direction: Vec3,
    /// ∂L/∂(its coefficient of degree 0).
    pub(super) pull: Vec3,
    /// The same where every pixel is wrong by 1; 0 where the view does not show it.
    pub(super) shown: f32,
}

impl Seen {
    fn residual(&self) -> Vec3 {
        self.pull / self.shown
    }
}

/// How the residuals of Gaussians vary between views.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ViewDependence {
    /// The share of it that harmonics of one degree explain; about 0 by chance, sometimes a little below, and about 1 at most.
    pub share: f32,
    /// By how much what they explain changes colours between views: a standard deviation, colour from 0 to 1.
    pub amplitude: f32,
    /// Gaussians that were seen in enough views.
    pub gaussians: usize,
}

impl Residuals {
    /// Of so many Gaussians, none seen yet.
    pub(super) fn of(gaussians: usize) -> Self {
        Self { of: vec![Vec::new(); gaussians] }
    }

    /// Adds what one view shows, by Gaussian.
    pub(super) fn add(&mut self, seen: impl Iterator<Item = Seen>) {
        for (views, seen) in self.of.iter_mut().zip(seen) {
            if seen.shown > 0.0 && seen.residual().is_finite() && seen.direction.is_finite() {
                views.push(seen);
            }
        }
    }

    /// What harmonics of this degree, 1 to 3, explain.
    pub(super) fn explained_by(&self, degree: u8) -> ViewDependence {
        let (mut above_chance, mut at_most, mut variance, mut weight, mut gaussians) =
            (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0);
        for of_one in &self.of {
            // A glimpse of it is wrong by what is before it.
            let most_shown = of_one.iter().map(|seen| seen.shown).fold(0.0, f32::max);
            let views: Vec<Seen> =
                of_one.iter().filter(|seen| seen.shown >= LEAST_SHOWN * most_shown).copied().collect();
            if views.len() < FEWEST_VIEWS {
                continue;
            }
            let Some(Moments { above, most, energy }) = moments(&views, degree) else { continue };
            above_chance += f64::from(most_shown) * above;
            at_most += f64::from(most_shown) * most;
            variance += f64::from(most_shown) * energy / (3 * (views.len() - 1)) as f64;
            weight += f64::from(most_shown);
            gaussians += 1;
        }
        let share = if at_most > 0.0 { (above_chance / at_most) as f32 } else { 0.0 };
        let amplitude = if weight > 0.0 { (variance / weight).sqrt() as f32 * share.max(0.0).sqrt() } else { 0.0 };
        ViewDependence { share, amplitude, gaussians }
    }
}

/// Fewer views of a Gaussian say nothing about where it is seen from.
const FEWEST_VIEWS: usize = 3;

/// Views that show less of a Gaussian than this part of the one that shows most are left out.
const LEAST_SHOWN: f32 = 0.2;

/// Of one Gaussian.
struct Moments {
    /// rᵀHKHr less what it would be by chance.
    above: f64,
    /// What that would be if the degree explained everything.
    most: f64,
    /// rᵀHr.
    energy: f64,
}

fn moments(views: &[Seen], degree: u8) -> Option<Moments> {
    let count = views.len() as f64;
    let mean = views.iter().map(Seen::residual).sum::<Vec3>() / count as f32;
    let residuals: Vec<_> = views.iter().map(|view| (view.residual() - mean).as_dvec3()).collect();
    let between = |v: &Seen, w: &Seen| legendre(degree, f64::from(v.direction.dot(w.direction)));
    let kernel: Vec<Vec<f64>> = views.iter().map(|v| views.iter().map(|w| between(v, w)).collect()).collect();
    let row_means: Vec<f64> = kernel.iter().map(|row| row.iter().sum::<f64>() / count).collect();
    let all = row_means.iter().sum::<f64>() / count;
    let (mut form, mut trace, mut square, mut energy) = (0.0, 0.0, 0.0, 0.0);
    for (v, row) in kernel.iter().enumerate() {
        energy += residuals[v].length_squared();
        for (w, &value) in row.iter().enumerate() {
            let value = value - row_means[v] - row_means[w] + all;
            form += value * residuals[v].dot(residuals[w]);
            square += value * value;
            trace += if v == w { value } else { 0.0 };
        }
    }
    // All from one direction: no degree could tell.
    let chance = trace / (count - 1.0);
    let most = if trace > 1e-9 { square / trace } else { chance };
    (most > chance * (1.0 + 1e-6)).then_some(Moments {
        above: form - energy * chance,
        most: energy * (most - chance),
        energy,
    })
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
            let seen: Vec<Seen> = (0..400)
                .map(|index| {
                    // From above, as most objects are photographed.
                    let across = Vec3::new(noise(&mut rng), noise(&mut rng), 1.0 + noise(&mut rng)).normalize();
                    let shown = 1.0 + 0.5 * noise(&mut rng);
                    Seen { direction: across, pull: shown * of(index, across, &mut rng), shown }
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
            // Seen from above only, neighbouring degrees look alike.
            let far = (0..3).filter(|&other| (degree as usize - 1).abs_diff(other) == 2).map(|other| shares[other]);
            assert!(far.into_iter().all(|share| share < own - 0.3), "degree {degree}: {shares:?}");
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
