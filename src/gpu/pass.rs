use std::time::{Duration, Instant};

use super::points::{self, Tile};
use super::shader::{WORKGROUP, layout_entry, pipeline, storage_entry};
use super::timing::Measured;
use super::{Gpu, GpuError, Sample, ShaderText};
use crate::rig::LocalPoints;

/// What a pass reads beside the points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Parameters {
    /// A storage buffer at binding 3.
    Buffer,
    /// A volume texture at binding 3, its sampler at binding 4, a uniform row of four numbers at binding 5.
    Volume,
}

/// How a pass divides the points, and how much it writes for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Grid {
    /// Points a workgroup.
    pub points_a_group: u32,
    /// Rows of four numbers that a point's result has.
    pub rows_a_point: u32,
}

impl Grid {
    /// A thread a point, which writes one row.
    pub const THREAD_A_POINT: Self = Self { points_a_group: WORKGROUP, rows_a_point: 1 };
}

/// A compiled pass over points, and the empty pass beside it.
#[derive(Clone, Debug)]
pub(super) struct PointPass {
    gpu: Gpu,
    grid: Grid,
    name: &'static str,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    empty: wgpu::ComputePipeline,
    /// What compiling took.
    pub once: Duration,
}

impl PointPass {
    /// Compiles `text`, which holds the entry point `name`.
    pub fn new(
        gpu: &Gpu,
        name: &'static str,
        text: ShaderText,
        parameters: Parameters,
        grid: Grid,
    ) -> Result<Self, GpuError> {
        let layout = gpu.checked(name, || Ok(bind_group_layout(gpu, name, parameters)))?;
        let empty_text = ShaderText::new().with_points().with(include_str!("passes/empty.wgsl"));
        let empty = pipeline(gpu, "empty", &empty_text, &layout)?;
        let start = Instant::now();
        let pipeline = pipeline(gpu, name, &text, &layout)?;
        let mut pass = Self { gpu: gpu.clone(), grid, name, layout, pipeline, empty, once: Duration::ZERO };
        pass.dispatch_nothing(parameters)?;
        pass.once = start.elapsed();
        Ok(pass)
    }

    /// A first dispatch over no points: some drivers compile only now.
    fn dispatch_nothing(&self, parameters: Parameters) -> Result<(), GpuError> {
        self.gpu.checked(self.name, || {
            let device = &self.gpu.device;
            let storage = self.gpu.storage("nothing", &[])?;
            let uniform = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("nothing"),
                size: 16,
                usage: wgpu::BufferUsages::UNIFORM,
                mapped_at_creation: false,
            });
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("nothing"),
                size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D3,
                format: wgpu::TextureFormat::Rgba16Float,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            let view = texture.create_view(&Default::default());
            let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            });
            let resources = match parameters {
                Parameters::Buffer => vec![storage.as_entire_binding()],
                Parameters::Volume => vec![
                    wgpu::BindingResource::TextureView(&view),
                    wgpu::BindingResource::Sampler(&sampler),
                    uniform.as_entire_binding(),
                ],
            };
            // a new buffer is zero: its tile ends before its first point
            let nothing = self.bind(&LocalPoints::default(), 0, &resources)?;
            nothing.submit(&self.pipeline, 0, 1, None);
            self.gpu.wait(self.name)
        })
    }

    fn result_bytes(&self) -> u64 {
        u64::from(self.grid.rows_a_point) * 16
    }

    /// Uploads the points, repeated until there are `total`, and binds them with the parameters.
    pub fn bind(
        &self,
        points: &LocalPoints<f32>,
        total: usize,
        parameters: &[wgpu::BindingResource<'_>],
    ) -> Result<BoundPass, GpuError> {
        self.gpu.checked(self.name, || {
            let packed = points::packed(points, total);
            let points = self.gpu.storage("the buffer of points", bytemuck::cast_slice(&packed))?;
            let result = self.gpu.output("the buffer of results", packed.len() as u64 * self.result_bytes())?;
            let largest = u64::from(self.gpu.device.limits().max_compute_workgroups_per_dimension);
            let most = largest * u64::from(self.grid.points_a_group) * u64::from(MOST_TILES);
            if packed.len() as u64 > most {
                return Err(GpuError::TooLarge { what: "the number of points", needed: total as u64, limit: most });
            }
            let tiles = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("tiles"),
                size: u64::from(MOST_TILES) * TILE_STRIDE,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let tile = wgpu::BufferBinding { buffer: &tiles, offset: 0, size: std::num::NonZeroU64::new(8) };
            let mut entries = vec![
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::Buffer(tile) },
                wgpu::BindGroupEntry { binding: 1, resource: points.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 2, resource: result.as_entire_binding() },
            ];
            for (i, resource) in parameters.iter().enumerate() {
                entries.push(wgpu::BindGroupEntry { binding: 3 + i as u32, resource: resource.clone() });
            }
            let bindings = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(self.name),
                layout: &self.layout,
                entries: &entries,
            });
            Ok(BoundPass {
                pass: self.clone(),
                bindings,
                tiles,
                result,
                count: packed.len(),
                tile_points: (FIRST_GROUPS * self.grid.points_a_group) as usize,
                has_run: false,
            })
        })
    }
}

/// A pass with its points and parameters, ready to run any number of times.
#[derive(Debug)]
pub(super) struct BoundPass {
    pass: PointPass,
    bindings: wgpu::BindGroup,
    tiles: wgpu::Buffer,
    result: wgpu::Buffer,
    count: usize,
    /// Points a dispatch, learnt by [`BoundPass::run`].
    tile_points: usize,
    has_run: bool,
}

/// The offset alignment of uniform buffers that every adapter has.
const TILE_STRIDE: u64 = 256;
/// Tiles a run: two timestamps each must fit into one query set of 4096, the empty run's beside them.
const MOST_TILES: u32 = 512;
/// Workgroups of the first tile of a first run. Few: what they cost is not known yet.
const FIRST_GROUPS: u32 = 64;
/// Tiles grow while they take less than a quarter of the 100 ms that one dispatch may take, and shrink above it.
const TILE_LOW: Duration = Duration::from_millis(25);
const TILE_HIGH: Duration = Duration::from_millis(80);

impl BoundPass {
    pub fn count(&self) -> usize {
        self.count
    }

    /// Runs over all points, one tile after the other, and learns how large a tile may be.
    pub fn run(&mut self) -> Result<(), GpuError> {
        let gpu = self.pass.gpu.clone();
        let points_a_group = self.pass.grid.points_a_group as usize;
        let widest = gpu.device.limits().max_compute_workgroups_per_dimension as usize * points_a_group;
        let mut first = 0;
        while first < self.count {
            let end = (first + self.tile_points).min(self.count);
            let took = gpu.checked(self.pass.name, || {
                let tile = Tile { first: first as u32, end: end as u32 };
                gpu.queue.write_buffer(&self.tiles, 0, bytemuck::bytes_of(&tile));
                let start = Instant::now();
                self.submit(&self.pass.pipeline, 0, (end - first) as u32, None);
                gpu.wait(self.pass.name)?;
                Ok(start.elapsed())
            })?;
            if took < TILE_LOW && end - first == self.tile_points {
                self.tile_points = (self.tile_points * 2).min(widest);
            } else if took > TILE_HIGH {
                self.tile_points = (self.tile_points / 2).max(points_a_group);
            }
            first = end;
        }
        self.has_run = true;
        // A timed run has no more tiles than there are slots for.
        self.tile_points = self.tile_points.max(self.count.div_ceil(MOST_TILES as usize));
        Ok(())
    }

    /// What the last run found, row after row.
    pub fn result(&self) -> Result<Vec<[f32; 4]>, GpuError> {
        let (gpu, name) = (&self.pass.gpu, self.pass.name);
        let bytes = self.count as u64 * self.pass.result_bytes();
        let read = gpu.checked(name, || gpu.read(&self.result, bytes, name))?;
        Ok(bytemuck::pod_collect_to_vec(&read))
    }

    /// One timed run over all points, less an empty one. Before the first, an untimed run learns the size of tiles.
    pub fn sample(&mut self) -> Result<Sample, GpuError> {
        if !self.has_run {
            self.run()?;
        }
        let gpu = &self.pass.gpu;
        gpu.checked(self.pass.name, || {
            let tiles: Vec<Tile> = (0..self.count)
                .step_by(self.tile_points)
                .map(|first| Tile { first: first as u32, end: (first + self.tile_points).min(self.count) as u32 })
                .collect();
            let mut slots = vec![0u8; tiles.len() * TILE_STRIDE as usize];
            for (slot, tile) in slots.chunks_exact_mut(TILE_STRIDE as usize).zip(&tiles) {
                slot[..8].copy_from_slice(bytemuck::bytes_of(tile));
            }
            gpu.queue.write_buffer(&self.tiles, 0, &slots);
            gpu.queue.submit([]);
            gpu.wait(self.pass.name)?;
            let stamps = gpu.timestamp_period.map(|period| Stamps::new(gpu, 2 * tiles.len() as u32, period));
            let empty =
                self.measure(&self.pass.empty, &vec![Tile { first: 0, end: 1 }; tiles.len()], stamps.as_ref())?;
            let run = self.measure(&self.pass.pipeline, &tiles, stamps.as_ref())?;
            Ok(Sample::net(run, empty))
        })
    }

    fn measure(
        &self,
        pipeline: &wgpu::ComputePipeline,
        tiles: &[Tile],
        stamps: Option<&Stamps>,
    ) -> Result<Measured, GpuError> {
        let start = Instant::now();
        for (slot, tile) in tiles.iter().enumerate() {
            self.submit(pipeline, slot as u32, tile.end - tile.first, stamps);
        }
        self.pass.gpu.wait(self.pass.name)?;
        let wall_ns = start.elapsed().as_nanos() as f64;
        let timestamp_ns = match stamps {
            Some(stamps) => Some(stamps.total_ns(&self.pass.gpu, self.pass.name)?),
            None => None,
        };
        Ok(Measured { timestamp_ns, wall_ns })
    }

    /// One dispatch over `points` points of tile `slot`, in a submission of its own.
    fn submit(&self, pipeline: &wgpu::ComputePipeline, slot: u32, points: u32, stamps: Option<&Stamps>) {
        let gpu = &self.pass.gpu;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(self.pass.name),
            timestamp_writes: stamps.map(|stamps| wgpu::ComputePassTimestampWrites {
                query_set: &stamps.queries,
                beginning_of_pass_write_index: Some(2 * slot),
                end_of_pass_write_index: Some(2 * slot + 1),
            }),
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &self.bindings, &[slot * TILE_STRIDE as u32]);
        pass.dispatch_workgroups(points.div_ceil(self.pass.grid.points_a_group), 1, 1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }
}

/// Timestamps at both ends of a number of passes.
struct Stamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    count: u32,
    period_ns: f64,
}

impl Stamps {
    fn new(gpu: &Gpu, count: u32, period_ns: f64) -> Self {
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timestamps"),
            ty: wgpu::QueryType::Timestamp,
            count,
        });
        let resolved = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("timestamps"),
            size: u64::from(count) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Self { queries, resolved, count, period_ns }
    }

    /// The time inside all passes together; NaN where a pass ended before it began.
    fn total_ns(&self, gpu: &Gpu, during: &str) -> Result<f64, GpuError> {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.resolve_query_set(&self.queries, 0..self.count, &self.resolved, 0);
        gpu.queue.submit([encoder.finish()]);
        let bytes = gpu.read(&self.resolved, u64::from(self.count) * 8, during)?;
        let ticks: Vec<u64> = bytes.chunks_exact(8).map(|b| u64::from_le_bytes(b.try_into().unwrap())).collect();
        let spans = ticks.chunks_exact(2).map(|pass| pass[1].checked_sub(pass[0]));
        Ok(spans.map(|ticks| ticks.map_or(f64::NAN, |ticks| ticks as f64 * self.period_ns)).sum())
    }
}

fn bind_group_layout(gpu: &Gpu, name: &str, parameters: Parameters) -> wgpu::BindGroupLayout {
    let uniform = |has_dynamic_offset, bytes| wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset,
        min_binding_size: std::num::NonZeroU64::new(bytes),
    };
    let mut entries = vec![layout_entry(0, uniform(true, 8)), storage_entry(1, true), storage_entry(2, false)];
    match parameters {
        Parameters::Buffer => entries.push(storage_entry(3, true)),
        Parameters::Volume => {
            let texture = wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: true },
                view_dimension: wgpu::TextureViewDimension::D3,
                multisampled: false,
            };
            entries.push(layout_entry(3, texture));
            entries.push(layout_entry(4, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)));
            entries.push(layout_entry(5, uniform(false, 16)));
        }
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(name), entries: &entries })
}
