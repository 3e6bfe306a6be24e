//! The buffers of one pass through the stages, and the passes themselves. Buffers are pooled, so that a warm iteration allocates
//! nothing.

use std::{
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use fearless_simd::{Level, dispatch};
use gs_core::{
    Binning, Blend, Canvas, Effects, Error, Image, Loss, RenderSettings, effects::Statistics, statistics::Culled,
};
use rayon::prelude::*;

use crate::{
    bin::Bins,
    blend_over, blend_sum,
    cloud::PlanarCloud,
    collect::{Nothing, collecting, numbers},
    dssim,
    layout::{Cuts, Grid, Row, ScalarRow, TileBuffers, for_each_tile},
    project::{CHUNK, Splat, project_all},
    project_bwd::{Gradient, gradient},
};

/// Rows of a tile under `Sum`: strips are kept whole as long as they fit into the second-level cache.
const SUM_BAND_ROWS: usize = 1024;

/// Rows of a tile under `Over`, where entries come in an order that jumps about the tile: it should stay in the first-level cache.
const OVER_BAND_ROWS: usize = 64;

/// One pass's inputs and results.
#[derive(Debug)]
pub(crate) struct Workspace {
    pub(crate) canvas: Canvas,
    pub(crate) settings: RenderSettings,
    pub(crate) grid: Grid,
    /// place → Gaussian: in which order tiles see them.
    pub(crate) order: Vec<u32>,
    /// Gaussian → place.
    pub(crate) place_of: Vec<u32>,
    /// The next place in each image row, while they are given out.
    row_places: Vec<u32>,
    pub(crate) splats: Vec<Splat>,
    pub(crate) bins: Bins,
    /// The image; under fused steps the residual.
    pub(crate) rows: Vec<Row>,
    pub(crate) transmittance: Vec<ScalarRow>,
    /// ∂L/∂image.
    pub(crate) v_rows: Vec<Row>,
    /// The mean of |C − Y| over a pixel's channels, 0 in lanes beyond the image; empty where nobody asks for it.
    pub(crate) errors: Vec<ScalarRow>,
    /// What each entry's Gaussian receives.
    pub(crate) slots: Vec<f32>,
    /// Numbers per entry in `slots`.
    pub(crate) stride: usize,
    /// One partial sum per tile, of whatever a pass sums.
    pub(crate) sums: Vec<f64>,
    pub(crate) culled: Culled,
    pub(crate) dssim: dssim::Scratch,
    /// Every Gaussian's gradient, by place: neighbours' entries are neighbours in memory.
    pub(crate) gradients: Vec<Gradient>,
    /// The cloud's edition that `order` and `bins` were made for.
    pub(crate) edition: Option<u64>,
}

impl Default for Workspace {
    fn default() -> Self {
        Self {
            canvas: Canvas::new(1, 1),
            settings: RenderSettings::default(),
            grid: Grid::default(),
            order: Vec::new(),
            place_of: Vec::new(),
            row_places: Vec::new(),
            splats: Vec::new(),
            bins: Bins::default(),
            rows: Vec::new(),
            transmittance: Vec::new(),
            v_rows: Vec::new(),
            errors: Vec::new(),
            slots: Vec::new(),
            stride: 0,
            sums: Vec::new(),
            culled: Culled::default(),
            dssim: dssim::Scratch::default(),
            gradients: Vec::new(),
            edition: None,
        }
    }
}

impl Workspace {
    /// Stages `project` and, unless the lists may be used again and can be, `bin`.
    ///
    /// # Errors
    /// Those of [`Bins::fill`]; the lists are then not used again.
    pub(crate) fn prepare(
        &mut self,
        cloud: &PlanarCloud,
        canvas: &Canvas,
        settings: &RenderSettings,
        binning: Binning,
    ) -> Result<(), Error> {
        let band_rows = match settings.effects.blend {
            Blend::Sum => SUM_BAND_ROWS,
            Blend::Over => OVER_BAND_ROWS,
        };
        let same = self.canvas == *canvas && self.settings == *settings && self.edition == Some(cloud.edition);
        let reuse = binning == Binning::Reuse && same;
        if !reuse {
            self.canvas = *canvas;
            self.settings = *settings;
            self.grid = Grid::new((canvas.width, canvas.height), band_rows);
            // Anew each time: an order that were kept would be state that no checkpoint holds.
            self.edition = None;
            self.arrange(cloud, settings.effects.blend);
        }
        self.project(cloud);
        if !reuse {
            self.bin()?;
            self.edition = Some(cloud.edition);
        }
        self.stride = self.gradient_stride() + numbers(settings.effects.statistics);
        self.rows.resize(self.grid.rows(), Row::ZERO);
        let errors = if self.collects_errors() { self.grid.rows() } else { 0 };
        self.errors.resize(errors, ScalarRow([0.0; 16]));
        self.sums.resize(self.grid.tiles(), 0.0);
        Ok(())
    }

    /// Numbers per entry in `slots` that are gradients; those for the statistics follow them.
    pub(crate) fn gradient_stride(&self) -> usize {
        match self.settings.effects.blend {
            Blend::Sum => blend_sum::STRIDE,
            Blend::Over => blend_over::STRIDE,
        }
    }

    /// Whether the backward pass needs the pixels' errors.
    pub(crate) fn collects_errors(&self) -> bool {
        self.settings.effects.statistics == Statistics::PixelError
    }

    /// Stage `project`.
    pub(crate) fn project(&mut self, cloud: &PlanarCloud) {
        let outside = self.culled.outside;
        self.culled = project_all(cloud, &self.canvas, &self.settings, &self.order, &mut self.splats);
        self.culled.outside = outside;
    }

    /// Stage `bin`.
    ///
    /// # Errors
    /// Those of [`Bins::fill`].
    pub(crate) fn bin(&mut self) -> Result<(), Error> {
        self.culled.outside = 0;
        self.bins.fill(&self.splats, &self.grid, &mut self.culled)
    }

    /// Decides in which order tiles see the Gaussians: by index where that matters, else by row, so that neighbours in a tile's
    /// list are neighbours in the cache.
    pub(crate) fn arrange(&mut self, cloud: &PlanarCloud, blend: Blend) {
        let n = cloud.len() as u32;
        self.place_of.clear();
        match blend {
            Blend::Over => self.place_of.extend(0..n),
            Blend::Sum => {
                // Counting sort, stable; NaN casts to row 0.
                let rows = self.grid.height;
                let row = |index: usize| (cloud.means[index].y as usize).min(rows - 1);
                self.row_places.clear();
                self.row_places.resize(rows, 0);
                (0..n as usize).for_each(|index| self.row_places[row(index)] += 1);
                let mut next = 0;
                for place in &mut self.row_places {
                    next += std::mem::replace(place, next);
                }
                for index in 0..n as usize {
                    let place = &mut self.row_places[row(index)];
                    self.place_of.push(*place);
                    *place += 1;
                }
            }
        }
        self.order.resize(n as usize, 0);
        for (index, &place) in self.place_of.iter().enumerate() {
            self.order[place as usize] = index as u32;
        }
    }

    /// Stage `blend`: the image, into `rows`.
    pub(crate) fn blend(&mut self, level: Level) {
        let settings = self.settings;
        let backdrop = settings.backdrop();
        let over = settings.effects.blend == Blend::Over;
        if over {
            self.transmittance.resize(self.grid.rows(), ScalarRow([1.0; 16]));
        } else {
            self.transmittance.clear();
        }
        let (splats, bins, grid) = (&self.splats, &self.bins, &self.grid);
        let cuts = Cuts { grid, tile_start: &bins.tile_start, stride: 0 };
        let buffers =
            TileBuffers { rows: &mut self.rows, scalars: &mut self.transmittance, slots: &mut [], sums: &mut [] };
        for_each_tile(0..grid.tiles(), buffers, cuts, &|tile, buffers| {
            let entries = &bins.entries[bins.tile_start[tile] as usize..bins.tile_start[tile + 1] as usize];
            let (column, rows) = grid.place(tile);
            if over {
                buffers.rows.fill(Row::ZERO);
                buffers.scalars.fill(ScalarRow([1.0; 16]));
                dispatch!(level, simd => blend_over::forward(
                    simd, entries, splats, &settings.accuracy, column, rows.start,
                    buffers.rows, buffers.scalars, backdrop,
                ));
            } else {
                buffers.rows.fill(Row(backdrop.map(|c| [c; 16])));
                dispatch!(level, simd => blend_sum::forward(simd, entries, splats, column, rows.start, buffers.rows));
            }
        });
    }

    /// Stage `blend_bwd`: from `v_rows` (and, under `Over`, the image, which is used up) into `slots`.
    pub(crate) fn blend_bwd(&mut self, level: Level) {
        let settings = self.settings;
        let (splats, bins, grid, v_rows, errors) = (&self.splats, &self.bins, &self.grid, &self.v_rows, &self.errors);
        self.slots.resize(bins.entries.len() * self.stride, 0.0);
        let cuts = Cuts { grid, tile_start: &bins.tile_start, stride: self.stride };
        let buffers = TileBuffers { rows: &mut self.rows, scalars: &mut [], slots: &mut self.slots, sums: &mut [] };
        for_each_tile(0..grid.tiles(), buffers, cuts, &|tile, buffers| {
            let entries = &bins.entries[bins.tile_start[tile] as usize..bins.tile_start[tile + 1] as usize];
            let (column, rows) = grid.place(tile);
            let v_rows = &v_rows[grid.first_row(tile)..][..rows.len()];
            let errors = if errors.is_empty() { &[] } else { &errors[grid.first_row(tile)..][..rows.len()] };
            collecting!(settings.effects.statistics, K => match settings.effects.blend {
                Blend::Sum => dispatch!(level, simd => blend_sum::backward::<_, K>(
                    simd, entries, splats, column, rows.start, v_rows, errors, buffers.slots,
                )),
                Blend::Over => dispatch!(level, simd => blend_over::backward::<_, K>(
                    simd, entries, splats, &settings.accuracy, column, rows.start, buffers.rows, v_rows, errors,
                    buffers.slots,
                )),
            });
        });
    }

    /// Whether a training step blends, compares and differentiates in one pass: where the kernel for it is, without sums for statistics.
    pub(crate) fn is_fused(effects: &Effects, loss: Loss) -> bool {
        loss == Loss::L2 && effects.blend == Blend::Sum && numbers(effects.statistics) == 0
    }

    /// Stages `blend`, `loss` (L2) and `blend_bwd` in one pass over the tiles, which stay in the cache; `Sum` only. Returns
    /// Σ (C − Y)²; `slots` receive the gradients of half of that.
    pub(crate) fn blend_l2_fused(&mut self, level: Level, target: &[Row]) -> f64 {
        let backdrop = self.settings.backdrop();
        let (splats, bins, grid) = (&self.splats, &self.bins, &self.grid);
        self.slots.resize(bins.entries.len() * self.stride, 0.0);
        let cuts = Cuts { grid, tile_start: &bins.tile_start, stride: self.stride };
        let buffers =
            TileBuffers { rows: &mut self.rows, scalars: &mut [], slots: &mut self.slots, sums: &mut self.sums };
        for_each_tile(0..grid.tiles(), buffers, cuts, &|tile, buffers| {
            let entries = &bins.entries[bins.tile_start[tile] as usize..bins.tile_start[tile + 1] as usize];
            let (column, rows) = grid.place(tile);
            let target = &target[grid.first_row(tile)..][..rows.len()];
            let inside = grid.lanes_inside(tile);
            dispatch!(level, simd => {
                blend_sum::start(simd, backdrop, target, buffers.rows);
                blend_sum::forward(simd, entries, splats, column, rows.start, buffers.rows);
                buffers.sums[0] = square_sum(buffers.rows, inside);
                blend_sum::backward::<_, Nothing>(
                    simd, entries, splats, column, rows.start, buffers.rows, &[], buffers.slots,
                );
            });
        });
        self.sums.iter().sum()
    }
}

impl Workspace {
    /// Stage `project_bwd`: every Gaussian's gradient, times `scale`, into `gradients` (by place).
    pub(crate) fn project_bwd(&mut self, cloud: &PlanarCloud, scale: f32) {
        let mut gradients = std::mem::take(&mut self.gradients);
        gradients.resize(cloud.len(), Gradient::default());
        let workspace = &*self;
        gradients.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, gradients)| {
            for (i, out) in gradients.iter_mut().enumerate() {
                *out = gradient(workspace, cloud, chunk * CHUNK + i, scale);
            }
        });
        self.gradients = gradients;
    }

    /// The gradient of Gaussian `index`.
    pub(crate) fn gradient_of(&self, index: usize) -> &Gradient {
        &self.gradients[self.place_of[index] as usize]
    }
}

/// Σ of the squares of a tile's values; lanes beyond the image become 0.
#[inline(always)]
fn square_sum(rows: &mut [Row], inside: usize) -> f64 {
    let mut lanes = [0.0f32; 16];
    let mut sum = 0.0;
    for chunk in rows.chunks_mut(64) {
        for Row(pixels) in chunk {
            for channel in pixels {
                channel[inside..].fill(0.0);
                for i in 0..16 {
                    lanes[i] += channel[i] * channel[i];
                }
            }
        }
        sum += lanes.iter().map(|&v| f64::from(v)).sum::<f64>();
        lanes = [0.0; 16];
    }
    sum
}

/// Workspaces that are not in use.
#[derive(Debug, Default)]
pub(crate) struct Pool(Mutex<Vec<Workspace>>);

impl Pool {
    pub(crate) fn take(&self) -> Workspace {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    pub(crate) fn give(&self, workspace: Workspace) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}

/// One forward pass on the CPU: the image, and what its backward pass needs.
pub struct PlanarFrame {
    /// `Some` until dropped.
    pub(crate) workspace: Option<Workspace>,
    pub(crate) pool: Arc<Pool>,
}

impl PlanarFrame {
    pub(crate) fn workspace(&self) -> &Workspace {
        self.workspace.as_ref().expect("a frame has its workspace until it is dropped")
    }

    pub(crate) fn image(&self) -> Image {
        let workspace = self.workspace();
        workspace.grid.image_of(&workspace.rows)
    }

    /// Pixel–Gaussian pairs that this frame's blending visited, those that a vector covers beyond an ellipse included.
    pub fn pairs(&self) -> u64 {
        self.workspace().bins.pairs()
    }

    /// Entries of all tiles' lists.
    pub fn entries(&self) -> usize {
        self.workspace().bins.entries.len()
    }
}

impl Drop for PlanarFrame {
    fn drop(&mut self) {
        if let Some(workspace) = self.workspace.take() {
            self.pool.give(workspace);
        }
    }
}

impl fmt::Debug for PlanarFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let workspace = self.workspace();
        f.debug_struct("PlanarFrame").field("canvas", &workspace.canvas).field("culled", &workspace.culled).finish()
    }
}
