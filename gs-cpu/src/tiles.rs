//! The buffers between projection and its way back, and the stages that work on them: the same for every kind of scene.

use std::ops::Range;

use fearless_simd::{Level, dispatch};
use glam::Vec2;
use gs_core::{
    Accuracy, Blend, Effects, Error, Loss, RenderSettings,
    effects::{Order, Statistics},
    memory,
    statistics::Culled,
};

use crate::{
    bin::{Bins, Entry},
    blend_over,
    blend_per_pixel::{self, PixelDepth, Scratch},
    blend_sum,
    collect::{Nothing, collecting, numbers},
    dssim,
    layout::{Cuts, Grid, MOST_ROWS_OVER, Row, ScalarRow, TileBuffers, for_each_tile},
    loss::{Target, squares_in_place},
    scratches::Scratches,
    splat::{Received, Splat},
    tuning::CpuTuning,
};

/// Rows of a tile under `Sum`: strips are kept whole as long as they fit into the second-level cache.
const SUM_BAND_ROWS: usize = 1024;

/// Rows of a tile under `Over`, where entries come in an order that jumps about the tile: it should stay in the first-level cache.
const OVER_BAND_ROWS: usize = MOST_ROWS_OVER;

/// Splats, their lists per tile, images, and what comes back. A *place* is a splat's rank in the order in which tiles see them.
#[derive(Debug, Default)]
pub(crate) struct Tiles {
    pub(crate) settings: RenderSettings,
    /// How the work is gone about.
    pub(crate) tuning: CpuTuning,
    pub(crate) grid: Grid,
    /// By place.
    pub(crate) projected: Vec<Splat>,
    /// By place, where pixels have their own order.
    pub(crate) depths: Vec<PixelDepth>,
    scratches: Scratches<Scratch>,
    /// A tile's rows, for passes that use them up before they come to the next tile.
    pub(crate) tile_rows: Scratches<Vec<Row>>,
    pub(crate) bins: Bins,
    /// The image, or the strips of it that were drawn last.
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
    /// What projection left out.
    pub(crate) culled: Culled,
    pub(crate) dssim: dssim::Scratch,
    /// The last target that this background or rendering had to complete.
    pub(crate) completed: Target,
}

/// A tile's lists, and where it is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight<'a> {
    pub(crate) entries: &'a [Entry],
    pub(crate) projected: &'a [Splat],
    /// By place, as the projected; empty where pixels have no order of their own.
    pub(crate) depths: &'a [PixelDepth],
    pub(crate) accuracy: &'a Accuracy,
    pub(crate) first_column: usize,
    pub(crate) first_row: usize,
    /// How many of its lanes are columns of the image.
    pub(crate) lanes_inside: usize,
}

impl Sight<'_> {
    /// The rows of the tile that an entry touches, first and end.
    #[inline(always)]
    pub(crate) fn rows_of(&self, entry: &Entry) -> [usize; 2] {
        entry.rows.map(|row| usize::from(row) - self.first_row)
    }
}

/// What the blend kernels read, apart from what they write.
#[derive(Clone, Copy)]
struct Lists<'a> {
    settings: &'a RenderSettings,
    grid: &'a Grid,
    projected: &'a [Splat],
    depths: &'a [PixelDepth],
    bins: &'a Bins,
}

impl<'a> Lists<'a> {
    fn of(&self, tile: usize) -> Sight<'a> {
        let (first_column, rows) = self.grid.place(tile);
        Sight {
            entries: self.bins.of(tile),
            projected: self.projected,
            depths: self.depths,
            accuracy: &self.settings.accuracy,
            first_column,
            first_row: rows.start,
            lanes_inside: self.grid.lanes_inside(tile),
        }
    }

    fn cuts(&self, stride: usize) -> Cuts<'a> {
        Cuts { grid: self.grid, tile_start: &self.bins.tile_start, stride }
    }
}

impl Tiles {
    /// Takes an image's size and settings.
    pub(crate) fn set(&mut self, size: (u32, u32), settings: &RenderSettings) {
        let usual = match settings.effects.blend {
            Blend::Sum => SUM_BAND_ROWS,
            Blend::Over => OVER_BAND_ROWS,
        };
        let band_rows = self.tuning.tile_rows.map_or(usual, usize::from);
        self.settings = *settings;
        self.grid = Grid::new(size, band_rows);
    }

    /// Gives the buffers of the stages from `blend` on their sizes, but for those that one stage alone knows.
    pub(crate) fn fit(&mut self) {
        self.stride = self.gradient_stride() + numbers(self.settings.effects.statistics);
        self.sums.resize(self.grid.tiles(), 0.0);
        self.tile_rows.fit();
        if self.settings.effects.order == Order::PerPixel {
            self.scratches.fit();
        }
    }

    /// Numbers per entry in `slots` that are gradients; those for the statistics follow them.
    fn gradient_stride(&self) -> usize {
        match self.settings.effects.blend {
            Blend::Sum => blend_sum::STRIDE,
            Blend::Over => blend_over::STRIDE,
        }
    }

    /// Whether the backward pass needs the pixels' errors.
    pub(crate) fn collects_errors(&self) -> bool {
        self.settings.effects.statistics == Statistics::PixelError
    }

    /// Half the image's size, by which gradients in px⁻¹ are multiplied to be in normalised device units.
    pub(crate) fn half_size(&self) -> Vec2 {
        Vec2::new(self.grid.width as f32, self.grid.height as f32) * 0.5
    }

    /// What the forward pass left out.
    pub(crate) fn culled(&self) -> Culled {
        self.culled.plus(Culled { outside: self.bins.outside, ..Culled::default() })
    }

    /// Stage `bin`.
    ///
    /// # Errors
    /// Those of [`Bins::fill`].
    pub(crate) fn bin(&mut self) -> Result<(), Error> {
        self.bins.fill(&self.projected, &self.grid, self.tuning.bounds)
    }

    /// Stage `blend`: the image, into `rows`.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn blend(&mut self, level: Level) -> Result<(), Error> {
        self.blend_tiles(level, 0..self.grid.tiles())
    }

    /// The image of these tiles, which are whole strips, into `rows`.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn blend_tiles(&mut self, level: Level, tiles: Range<usize>) -> Result<(), Error> {
        let Effects { blend, order, .. } = self.settings.effects;
        let background = self.settings.background_color();
        let count = self.grid.first_row(tiles.end) - self.grid.first_row(tiles.start);
        memory::resize(&mut self.rows, count, Row::ZERO, "the strips of an image")?;
        let transmittances = if blend == Blend::Over { count } else { 0 };
        memory::resize(&mut self.transmittance, transmittances, ScalarRow([1.0; 16]), "the pixels' transmittances")?;
        let Self { settings, grid, projected, depths, bins, rows, transmittance, scratches, .. } = self;
        let lists = Lists { settings, grid, projected, depths, bins };
        let buffers = TileBuffers { rows, scalars: transmittance, slots: &mut [], sums: &mut [] };
        for_each_tile(tiles, buffers, lists.cuts(0), &|tile, buffers| {
            let TileBuffers { rows, scalars, .. } = buffers;
            let sight = lists.of(tile);
            match (blend, order) {
                (Blend::Sum, _) => {
                    rows.fill(Row(background.map(|c| [c; 16])));
                    let Sight { entries, projected, first_column, first_row, .. } = sight;
                    dispatch!(level, simd => blend_sum::forward(simd, entries, projected, first_column, first_row, rows));
                }
                (Blend::Over, Order::PerPixel) => scratches.with(|scratch| {
                    blend_per_pixel::forward(level, &sight, scratch, rows, scalars, background);
                }),
                (Blend::Over, _) => {
                    dispatch!(level, simd => blend_over::forward(simd, &sight, rows, scalars, background))
                }
            }
        });
        Ok(())
    }

    /// Gives `slots` their size, for so many numbers per entry.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn fit_slots(&mut self, stride: usize) -> Result<(), Error> {
        let what = "the gradients of all pairs of a Gaussian and a tile";
        memory::resize(&mut self.slots, self.bins.entries.len() * stride, 0.0, what)
    }

    /// Stage `blend_bwd`: from `v_rows` (and, under `Over`, the image, which is used up) into `slots`.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn blend_bwd(&mut self, level: Level) -> Result<(), Error> {
        let Effects { blend, order, statistics, .. } = self.settings.effects;
        self.fit_slots(self.stride)?;
        let Self { settings, grid, projected, depths, bins, rows, v_rows, errors, slots, scratches, .. } = self;
        let lists = Lists { settings, grid, projected, depths, bins };
        let buffers = TileBuffers { rows, scalars: &mut [], slots, sums: &mut [] };
        for_each_tile(0..grid.tiles(), buffers, lists.cuts(self.stride), &|tile, buffers| {
            let TileBuffers { rows, slots, .. } = buffers;
            let sight = lists.of(tile);
            let of_tile = grid.first_row(tile)..grid.first_row(tile) + rows.len();
            let errors = if errors.is_empty() { &[] } else { &errors[of_tile.clone()] };
            let v_rows = &v_rows[of_tile];
            collecting!(statistics, K => match (blend, order) {
                (Blend::Sum, _) => {
                    let Sight { entries, projected, first_column, first_row, .. } = sight;
                    dispatch!(level, simd => blend_sum::backward::<_, K>(
                        simd, entries, projected, first_column, first_row, v_rows, errors, slots,
                    ));
                }
                (Blend::Over, Order::PerPixel) => scratches.with(|scratch| {
                    blend_per_pixel::backward::<K>(level, &sight, scratch, rows, v_rows, errors, slots);
                }),
                (Blend::Over, _) => dispatch!(level, simd => blend_over::backward::<_, K>(
                    simd, &sight, rows, v_rows, errors, slots,
                )),
            });
        });
        Ok(())
    }

    /// Whether a training step blends, compares and differentiates in one pass: where the kernel for it is, without sums for statistics.
    pub(crate) fn is_fused(effects: &Effects, loss: Loss) -> bool {
        loss == Loss::L2 && effects.blend == Blend::Sum && numbers(effects.statistics) == 0
    }

    /// Stages `blend`, `loss` (L2) and `blend_bwd` in one pass over the tiles, which stay in the cache; `Sum` only. Returns
    /// Σ (C − Y)²; `slots` receive the gradients of half of that. C is to the bit what [`Self::blend`] shows, so that both are exactly 0 where
    /// that is the target: Adam would make whole steps of a rounding.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn blend_l2_fused(&mut self, level: Level, target: &[Row]) -> Result<f64, Error> {
        let background = self.settings.background_color();
        self.fit_slots(self.stride)?;
        let Self { settings, grid, projected, depths, bins, tile_rows, slots, sums, .. } = self;
        let lists = Lists { settings, grid, projected, depths, bins };
        let buffers = TileBuffers { rows: &mut [], scalars: &mut [], slots, sums };
        for_each_tile(0..grid.tiles(), buffers, lists.cuts(self.stride), &|tile, buffers| {
            let Sight { entries, projected, first_column: column, first_row, lanes_inside: inside, .. } =
                lists.of(tile);
            let target = &target[grid.first_row(tile)..grid.first_row(tile + 1)];
            tile_rows.with(|rows| {
                rows.resize(target.len(), Row::ZERO);
                dispatch!(level, simd => {
                    rows.fill(Row(background.map(|c| [c; 16])));
                    blend_sum::forward(simd, entries, projected, column, first_row, rows);
                    buffers.sums[0] = squares_in_place(simd, rows, target, inside);
                    blend_sum::backward::<_, Nothing>(
                        simd, entries, projected, column, first_row, rows, &[], buffers.slots,
                    );
                });
            });
        });
        Ok(self.sums.iter().sum())
    }

    /// Sums what the entries of the splat at `place` received, in the order of its tiles; `None` where no tile lists it.
    #[inline(always)]
    pub(crate) fn received(&self, place: usize) -> Option<Received> {
        let slots = self.bins.slots_of(place);
        if slots.is_empty() {
            return None;
        }
        let gradient_stride = self.gradient_stride();
        let (mut sum, mut collected) = ([0.0f32; 9], [0.0f32; 2]);
        for &slot in slots {
            let slot = &self.slots[slot as usize * self.stride..][..self.stride];
            for (total, value) in sum.iter_mut().zip(&slot[..gradient_stride]) {
                *total += value;
            }
            for (total, value) in collected.iter_mut().zip(&slot[gradient_stride..]) {
                *total += value;
            }
        }
        let [r, g, b, x, u, xx, xu, uu, zeroth] = sum;
        Some(Received { color: [r, g, b], first: Vec2::new(x, u), second: [xx, xu, uu], zeroth, collected })
    }
}
