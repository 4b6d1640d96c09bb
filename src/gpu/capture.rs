use std::collections::HashMap;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use glam::DVec3;

use super::shader::{WORKGROUP, layout_entry, pipeline, storage_entry};
use super::trace::{KIND_MAP, LIGHT_ROWS, Packed};
use super::{Gpu, GpuError, ShaderText};
use crate::light::{Constant, Light};
use crate::probe::{CaptureTask, FACES, ProbeDevice, texels};
use crate::sh::{MAX_ORDER, coefficients};
use crate::trace::{
    Capture, CapturePlace, Counters, DepthSums, Depths, Effects, Projected, SILHOUETTE_COSINE, TracedGeometry,
    Transport,
};

/// Rows of a record, as capture_shade.wgsl writes it.
const RECORD_ROWS: u64 = 6;
/// Records that a workgroup projects.
const CHUNK: u32 = 256;
/// Records of one dispatch: 25 MB.
const MOST_RECORDS: u32 = 1 << 18;
/// Records of a first dispatch, of which it is not known yet what they cost.
const FIRST_RECORDS: u32 = 16 * CHUNK;
/// Texels of the faces that are rasterised at once, two images of 4 bytes; and triangles that are drawn at once.
const MOST_TEXELS: usize = 1 << 23;
const MOST_DRAWN: usize = 1 << 20;
/// Dispatches grow while they take less than this, and shrink above the other.
const SHORT: Duration = Duration::from_millis(25);
const LONG: Duration = Duration::from_millis(80);
/// Surfaces nearer along a face's axis than this share of the scene's half diagonal are not seen.
const NEAR: f32 = 1e-5;
/// The offset alignment of uniform buffers that every adapter has.
const VIEW_STRIDE: u64 = 256;
/// Kinds of lights in the packed scene that have no extent: lines, points, directions.
const KIND_TUBE: u32 = 3;

/// The passes of a capture, for tests that break one.
#[derive(Clone, Copy, Debug)]
pub struct CaptureShaders<'t> {
    pub rasterise: &'t str,
    pub shade: &'t str,
    pub project: &'t str,
}

impl CaptureShaders<'static> {
    pub const OWN: Self = Self {
        rasterise: include_str!("passes/capture_rasterise.wgsl"),
        shade: include_str!("passes/capture_shade.wgsl"),
        project: include_str!("passes/capture_project.wgsl"),
    };
}

/// Cube maps of a static scene under lights: faces rasterised with a depth buffer, each texel shaded and projected to SH on the device.
///
/// The twin of [`Transport::capture`]. Directions and solid angles of the texels are the same; which triangle a texel sees is the
/// rasteriser's to say, so that texels on edges may differ; what surfaces reflect comes by paths with other random numbers.
pub struct CubeCapturer {
    gpu: Gpu,
    scene: wgpu::Buffer,
    corners: wgpu::Buffer,
    triangles: usize,
    origin: DVec3,
    /// Rows of lights without extent: index, and whether it is a line.
    extras: Vec<(u32, bool)>,
    raster: Raster,
    shade: wgpu::ComputePipeline,
    shade_layout: wgpu::BindGroupLayout,
    project_text: String,
    project_layout: wgpu::BindGroupLayout,
    /// By order, and whether with derivatives.
    projections: Mutex<HashMap<(usize, bool), wgpu::ComputePipeline>>,
    /// Of the layout, for what is singular.
    lights: Vec<Light<f64>>,
    once: Duration,
}

/// The pipeline that draws a face.
struct Raster {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

/// What a place's records sum to.
struct Sums {
    /// Coefficients of value and derivatives, channel by channel.
    numbers: Vec<f64>,
    inverse: f64,
    nearest: f64,
    behind: f64,
    sees: f64,
    counted: [f64; 4],
}

#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Job {
    first: u32,
    end: u32,
    records_a_place: u32,
    face: u32,
    extras: u32,
    paths: u32,
    depth_alone: u32,
    unused: u32,
}

impl CubeCapturer {
    /// The environment, lights and effects of a transport.
    pub fn new(gpu: &Gpu, transport: &Transport, seed: u64) -> Result<Self, GpuError> {
        Self::with_shaders(gpu, transport, seed, CaptureShaders::OWN)
    }

    /// With other texts than the passes' own: for tests that break them.
    pub fn with_shaders(
        gpu: &Gpu,
        transport: &Transport,
        seed: u64,
        shaders: CaptureShaders,
    ) -> Result<Self, GpuError> {
        let start = Instant::now();
        let effects = transport.effects();
        let nothing = TracedGeometry::default();
        let geometry = if effects == Effects::NONE { &nothing } else { transport.tracer().geometry() };
        let mut lights = transport.lights().to_vec();
        lights.push(Light::Constant(Constant { radiance: transport.surroundings() }));
        let packed = Packed::new(geometry, &lights, effects, seed)?;
        let corners: Vec<[f32; 3]> = packed
            .sources
            .iter()
            .flat_map(|source| geometry.triangles[*source as usize])
            .map(|corner| (corner - packed.origin).as_vec3().to_array())
            .collect();
        let extras = (0..packed.light_count as u32)
            .filter_map(|index| {
                let kind = packed.rows[packed.lights + LIGHT_ROWS * index as usize][3].to_bits();
                (KIND_TUBE..KIND_MAP).contains(&kind).then_some((index, kind == KIND_TUBE))
            })
            .collect();

        let faces = face_axes();
        let raster =
            ShaderText::new().with_number("NEAR", NEAR * packed.half_diagonal).with(&faces).with(shaders.rasterise);
        let raster = Raster::new(gpu, &raster)?;
        let shade_layout = gpu.checked("capture_shade", || Ok(shade_layout(gpu)))?;
        let text = packed
            .text()
            .with_number("SILHOUETTE_COSINE", SILHOUETTE_COSINE as f32)
            .with(&faces)
            .with(include_str!("passes/trace_probes.wgsl"))
            .with(shaders.shade);
        let shade = pipeline(gpu, "capture_shade", &text, &shade_layout)?;
        let project_layout = gpu.checked("capture_project", || Ok(project_layout(gpu)))?;
        let (scene, corners) = gpu.checked("uploading the scene", || {
            let scene = gpu.storage("the buffer of the scene", bytemuck::cast_slice(&packed.rows))?;
            Ok((scene, vertices(gpu, &corners)))
        })?;
        Ok(Self {
            gpu: gpu.clone(),
            scene,
            corners,
            triangles: packed.sources.len(),
            origin: packed.origin,
            extras,
            raster,
            shade,
            shade_layout,
            project_text: shaders.project.to_owned(),
            project_layout,
            projections: Mutex::default(),
            lights,
            once: start.elapsed(),
        })
    }

    /// What compiling and uploading took.
    pub fn once(&self) -> Duration {
        self.once
    }

    fn projection(&self, order: usize, gradient: bool) -> Result<wgpu::ComputePipeline, GpuError> {
        let mut known = self.projections.lock().expect("no holder panics");
        if let Some(pipeline) = known.get(&(order, gradient)) {
            return Ok(pipeline.clone());
        }
        let text = ShaderText::new()
            .with_basis(order)
            .with_basis_gradient()
            .with_count("BLOCKS", if gradient { 4 } else { 1 })
            .with_count("CHUNK", CHUNK)
            .with(&self.project_text);
        let made = pipeline(&self.gpu, "capture_project", &text, &self.project_layout)?;
        known.insert((order, gradient), made.clone());
        Ok(made)
    }

    /// Faces are rasterised a batch of places at a time, their texels shaded and summed a tile at a time: short dispatches, bounded memory.
    pub fn capture(&self, places: &[CapturePlace], task: CaptureTask) -> Result<Vec<Capture>, GpuError> {
        assert!((1..=MAX_ORDER).contains(&task.order), "order {}", task.order);
        let stride = coefficients(task.order);
        let blocks = if task.gradient { 4 } else { 1 };
        let pipeline = self.projection(task.order, task.gradient)?;
        let mut captures = Vec::with_capacity(places.len());
        for places in places.chunks(self.places_at_once(task.face)) {
            let run = Run::new(self, places, task.face)?;
            run.rasterise()?;
            for (sums, place) in run.project(&pipeline, blocks * stride, task.paths)?.iter().zip(places) {
                let [closest, shadow, terms, clamped] = sums.counted.map(|count| count.round() as u64);
                captures.push(Capture {
                    projected: Projected::from_numbers(&sums.numbers, stride),
                    depths: Depths {
                        harmonic_mean: 4.0 * std::f64::consts::PI / sums.inverse,
                        minimum: if sums.sees > 0.0 { sums.nearest } else { f64::INFINITY },
                        behind: sums.behind / (4.0 * std::f64::consts::PI),
                    },
                    singular: singular_terms(&self.lights, place.position),
                    counters: Counters {
                        closest_rays: closest,
                        shadow_rays: shadow,
                        gradient_terms: if task.gradient { terms } else { 0 },
                        clamped_gradients: if task.gradient { clamped } else { 0 },
                        texels: 6 * u64::from(task.face).pow(2),
                        draws: 6,
                        ..Counters::default()
                    },
                });
            }
        }
        Ok(captures)
    }

    /// Signed distances of what the texels of cube maps see, in the order of [`texels`]: 0 nothing, negative the back of a surface.
    pub fn look(&self, places: &[DVec3], face: u32) -> Result<Vec<Vec<f32>>, GpuError> {
        let places: Vec<CapturePlace> = places.iter().map(|p| CapturePlace { position: *p, numbers_of: *p }).collect();
        let mut seen = Vec::with_capacity(places.len());
        for places in places.chunks(self.places_at_once(face)) {
            let run = Run::new(self, places, face)?;
            run.rasterise()?;
            seen.extend(run.distances()?);
        }
        Ok(seen)
    }

    fn places_at_once(&self, face: u32) -> usize {
        let layers = self.gpu.device.limits().max_texture_array_layers as usize;
        let by_texels = MOST_TEXELS / (face * face) as usize;
        let by_triangles = MOST_DRAWN / self.triangles.max(1);
        (layers.min(by_texels).min(by_triangles) / 6).max(1)
    }
}

impl ProbeDevice for CubeCapturer {
    fn capture(&self, places: &[CapturePlace], task: CaptureTask) -> Result<Vec<Capture>, String> {
        CubeCapturer::capture(self, places, task).map_err(|error| error.to_string())
    }

    fn depths(&self, places: &[DVec3], face: u32) -> Result<Vec<(Depths, Vec<DVec3>)>, String> {
        let texels = texels(face as usize);
        let seen = self.look(places, face).map_err(|error| error.to_string())?;
        Ok(places
            .iter()
            .zip(seen)
            .map(|(place, distances)| {
                let (mut sums, mut met) = (DepthSums::default(), Vec::new());
                for (texel, signed) in texels.iter().zip(distances) {
                    let distance = f64::from(signed.abs());
                    sums.add(texel.solid_angle, (signed != 0.0).then_some((distance, signed > 0.0)));
                    if signed != 0.0 {
                        met.push(*place + texel.direction * distance);
                    }
                }
                (sums.depths(), met)
            })
            .collect())
    }
}

/// Lights without extent that reach `p` with no finite value.
fn singular_terms(lights: &[Light<f64>], p: DVec3) -> u32 {
    use crate::light::LightShape;
    let p = crate::math::Vector3::of(p);
    let unseen = lights.iter().filter(|light| light.sample(p, [0.5; 2]).is_none());
    unseen.map(|light| light.projection::<1>(p).singular).sum()
}

/// `face_axes(face)`: columns along a row of texels, along a column of them, forward.
fn face_axes() -> String {
    let mut text = String::from("fn face_axes(face: u32) -> mat3x3f {\n    switch face {\n");
    for (index, [forward, right, down]) in FACES.iter().enumerate() {
        let column = |v: &DVec3| format!("vec3f({:?}, {:?}, {:?})", v.x, v.y, v.z);
        let label = if index + 1 < FACES.len() { format!("case {index}u") } else { "default".to_owned() };
        text += &format!(
            "        {label}: {{ return mat3x3f({}, {}, {}); }}\n",
            column(right),
            column(down),
            column(forward)
        );
    }
    text + "    }\n}\n"
}

fn vertices(gpu: &Gpu, corners: &[[f32; 3]]) -> wgpu::Buffer {
    use wgpu::util::DeviceExt;
    let none = [[0.0f32; 3]];
    gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("corners"),
        contents: bytemuck::cast_slice(if corners.is_empty() { &none } else { corners }),
        usage: wgpu::BufferUsages::VERTEX,
    })
}

fn uniform(has_dynamic_offset: bool, bytes: u64) -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset,
        min_binding_size: std::num::NonZeroU64::new(bytes),
    }
}

fn shade_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Uint,
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("capture_shade"),
        entries: &[
            storage_entry(3, true),
            layout_entry(4, uniform(false, 32)),
            storage_entry(5, true),
            storage_entry(6, true),
            layout_entry(7, texture),
            storage_entry(8, false),
        ],
    })
}

fn project_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("capture_project"),
        entries: &[storage_entry(0, true), storage_entry(1, false), layout_entry(2, uniform(false, 16))],
    })
}

const SEEN: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

impl Raster {
    fn new(gpu: &Gpu, text: &ShaderText) -> Result<Self, GpuError> {
        let module = text.compile(gpu, "capture_rasterise")?;
        gpu.checked("the pipeline capture_rasterise", || {
            let entry = wgpu::BindGroupLayoutEntry {
                visibility: wgpu::ShaderStages::VERTEX,
                ..layout_entry(0, uniform(true, 16))
            };
            let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("capture_rasterise"),
                entries: &[entry],
            });
            let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("capture_rasterise"),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
            let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some("capture_rasterise"),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("capture_vertex"),
                    compilation_options: Default::default(),
                    buffers: &[Some(wgpu::VertexBufferLayout {
                        array_stride: 12,
                        step_mode: wgpu::VertexStepMode::Vertex,
                        attributes: &wgpu::vertex_attr_array![0 => Float32x3],
                    })],
                },
                // either side is seen
                primitive: wgpu::PrimitiveState { cull_mode: None, ..Default::default() },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("capture_fragment"),
                    compilation_options: Default::default(),
                    targets: &[Some(SEEN.into())],
                }),
                multiview_mask: None,
                cache: None,
            });
            Ok(Self { pipeline, layout })
        })
    }
}

/// Cube maps around some places.
struct Run<'c> {
    capturer: &'c CubeCapturer,
    face: u32,
    places: usize,
    /// A layer a face.
    seen: wgpu::Texture,
    depth: wgpu::Texture,
    views: wgpu::Buffer,
    /// Lights without extent, then places.
    rows: wgpu::Buffer,
    extras: u32,
    records_a_place: u32,
}

impl<'c> Run<'c> {
    fn new(capturer: &'c CubeCapturer, places: &[CapturePlace], face: u32) -> Result<Self, GpuError> {
        let gpu = &capturer.gpu;
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if face > limit {
            let (needed, limit) = (u64::from(face), u64::from(limit));
            return Err(GpuError::TooLarge { what: "a face of the captures, in texels,", needed, limit });
        }
        let about = |p: DVec3| (p - capturer.origin).as_vec3();
        // a line as many places as a face has texels along its edge
        let mut rows: Vec<[f32; 4]> = Vec::new();
        for (index, is_line) in &capturer.extras {
            let count = if *is_line { face } else { 1 };
            let share = 1.0 / count as f32;
            rows.extend((0..count).map(|k| [f32::from_bits(*index), (k as f32 + 0.5) * share, share, 0.0]));
        }
        let extras = rows.len() as u32;
        for place in places {
            rows.extend([place.position, place.numbers_of].map(|p| about(p).extend(0.0).to_array()));
        }
        let mut slots = vec![0u8; 6 * places.len() * VIEW_STRIDE as usize];
        for (view, slot) in slots.chunks_exact_mut(VIEW_STRIDE as usize).enumerate() {
            let row = about(places[view / 6].position).extend(f32::from_bits(view as u32 % 6)).to_array();
            slot[..16].copy_from_slice(bytemuck::bytes_of(&row));
        }
        let layers = 6 * places.len() as u32;
        let image = |layers: u32, format, usage| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("capture"),
                size: wgpu::Extent3d { width: face, height: face, depth_or_array_layers: layers },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            })
        };
        gpu.checked("the images of captures", || {
            use wgpu::util::DeviceExt;
            let views = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("views"),
                contents: &slots,
                usage: wgpu::BufferUsages::UNIFORM,
            });
            Ok(Self {
                capturer,
                face,
                places: places.len(),
                seen: image(layers, SEEN, wgpu::TextureUsages::TEXTURE_BINDING),
                depth: image(1, DEPTH, wgpu::TextureUsages::empty()),
                views,
                rows: gpu.storage("the places of captures", bytemuck::cast_slice(&rows))?,
                extras,
                records_a_place: (6 * face * face + extras).next_multiple_of(CHUNK),
            })
        })
    }

    /// Draws the geometry once a face.
    fn rasterise(&self) -> Result<(), GpuError> {
        let CubeCapturer { gpu, raster, corners, triangles, .. } = self.capturer;
        gpu.checked("capture_rasterise", || {
            let view = wgpu::BufferBinding { buffer: &self.views, offset: 0, size: std::num::NonZeroU64::new(16) };
            let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("capture_rasterise"),
                layout: &raster.layout,
                entries: &[wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::Buffer(view) }],
            });
            let depth = self.depth.create_view(&Default::default());
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            for layer in 0..6 * self.places as u32 {
                let face = self.seen.create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(wgpu::TextureViewDimension::D2),
                    base_array_layer: layer,
                    array_layer_count: Some(1),
                    ..Default::default()
                });
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("capture_rasterise"),
                    color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                        view: &face,
                        depth_slice: None,
                        resolve_target: None,
                        ops: wgpu::Operations {
                            load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                            store: wgpu::StoreOp::Store,
                        },
                    })],
                    depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                        view: &depth,
                        depth_ops: Some(wgpu::Operations {
                            load: wgpu::LoadOp::Clear(0.0),
                            store: wgpu::StoreOp::Discard,
                        }),
                        stencil_ops: None,
                    }),
                    ..Default::default()
                });
                pass.set_pipeline(&raster.pipeline);
                pass.set_bind_group(0, &bindings, &[layer * VIEW_STRIDE as u32]);
                pass.set_vertex_buffer(0, corners.slice(..));
                pass.draw(0..3 * *triangles as u32, 0..1);
            }
            gpu.queue.submit([encoder.finish()]);
            gpu.wait("capture_rasterise")
        })
    }

    /// Records of all texels, a tile at a time; `then` is encoded after each with the tile's first record and its records.
    fn shade(
        &self,
        paths: u32,
        depth_alone: bool,
        mut then: impl FnMut(&mut wgpu::CommandEncoder, &wgpu::Buffer, u32, u32),
        mut after: impl FnMut(&wgpu::Buffer, u32) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let CubeCapturer { gpu, .. } = self.capturer;
        let total = self.places as u32 * self.records_a_place;
        let most = total.min(MOST_RECORDS);
        let angles: Vec<f32> = texels(self.face as usize)[..(self.face * self.face) as usize]
            .iter()
            .map(|texel| texel.solid_angle as f32)
            .collect();
        let (records, job, bindings) = gpu.checked("capture_shade", || {
            let records = gpu.output("the records of captures", u64::from(most) * RECORD_ROWS * 16)?;
            let angles = gpu.storage("solid angles", bytemuck::cast_slice(&angles))?;
            let job = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("job"),
                size: 32,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let seen = self.seen.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            });
            let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("capture_shade"),
                layout: &self.capturer.shade_layout,
                entries: &[
                    wgpu::BindGroupEntry { binding: 3, resource: self.capturer.scene.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 4, resource: job.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 5, resource: self.rows.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 6, resource: angles.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 7, resource: wgpu::BindingResource::TextureView(&seen) },
                    wgpu::BindGroupEntry { binding: 8, resource: records.as_entire_binding() },
                ],
            });
            Ok((records, job, bindings))
        })?;
        let mut tile = FIRST_RECORDS.min(most);
        let mut first = 0;
        while first < total {
            let end = (first + tile).min(total);
            let took = gpu.checked("capture_shade", || {
                let task = Job {
                    first,
                    end,
                    records_a_place: self.records_a_place,
                    face: self.face,
                    extras: self.extras,
                    paths,
                    depth_alone: u32::from(depth_alone),
                    unused: 0,
                };
                gpu.queue.write_buffer(&job, 0, bytemuck::bytes_of(&task));
                let start = Instant::now();
                let mut encoder = gpu.device.create_command_encoder(&Default::default());
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some("capture_shade"),
                    timestamp_writes: None,
                });
                pass.set_pipeline(&self.capturer.shade);
                pass.set_bind_group(0, &bindings, &[]);
                pass.dispatch_workgroups((end - first).div_ceil(WORKGROUP), 1, 1);
                drop(pass);
                then(&mut encoder, &records, first, end - first);
                gpu.queue.submit([encoder.finish()]);
                gpu.wait("capture_shade")?;
                Ok(start.elapsed())
            })?;
            after(&records, end - first)?;
            if took < SHORT && end - first == tile {
                tile = (2 * tile).min(most);
            } else if took > LONG {
                tile = (tile / 2).next_multiple_of(CHUNK);
            }
            first = end;
        }
        Ok(())
    }

    /// SH of every place: `numbers` coefficients of value and derivatives.
    fn project(&self, pipeline: &wgpu::ComputePipeline, numbers: usize, paths: u32) -> Result<Vec<Sums>, GpuError> {
        let CubeCapturer { gpu, .. } = self.capturer;
        let chunks_a_place = (self.records_a_place / CHUNK) as usize;
        let rows = numbers + 2;
        let bytes = (self.places * chunks_a_place * rows * 16) as u64;
        let (sums, first_chunk) = gpu.checked("capture_project", || {
            let first_chunk = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("first chunk"),
                size: 16,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            Ok((gpu.output("the sums of captures", bytes)?, first_chunk))
        })?;
        let then = |encoder: &mut wgpu::CommandEncoder, records: &wgpu::Buffer, first: u32, count: u32| {
            gpu.queue.write_buffer(&first_chunk, 0, bytemuck::cast_slice(&[first / CHUNK, 0, 0, 0]));
            let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("capture_project"),
                layout: &self.capturer.project_layout,
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: records.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 1, resource: sums.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 2, resource: first_chunk.as_entire_binding() },
                ],
            });
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("capture_project"),
                timestamp_writes: None,
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bindings, &[]);
            pass.dispatch_workgroups(count / CHUNK, 1, 1);
        };
        self.shade(paths, false, then, |_, _| Ok(()))?;
        let read = gpu.checked("capture_project", || gpu.read(&sums, bytes, "capture_project"))?;
        let read: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&read);
        let places = read.chunks_exact(chunks_a_place * rows);
        Ok(places.map(|chunks| Sums::of(chunks.chunks_exact(rows), numbers)).collect())
    }

    /// Signed distances of all texels, place after place.
    fn distances(&self) -> Result<Vec<Vec<f32>>, GpuError> {
        let gpu = &self.capturer.gpu;
        let mut all: Vec<f32> = Vec::with_capacity(self.places * self.records_a_place as usize);
        let after = |records: &wgpu::Buffer, count: u32| {
            let bytes = u64::from(count) * RECORD_ROWS * 16;
            let read = gpu.checked("the depths of captures", || gpu.read(records, bytes, "the depths of captures"))?;
            let rows: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&read);
            all.extend(rows.iter().step_by(RECORD_ROWS as usize).map(|row| row[3]));
            Ok(())
        };
        self.shade(0, true, |_, _, _, _| (), after)?;
        let texels = 6 * (self.face * self.face) as usize;
        Ok(all.chunks_exact(self.records_a_place as usize).map(|place| place[..texels].to_vec()).collect())
    }
}

impl Sums {
    fn of<'r>(chunks: impl Iterator<Item = &'r [[f32; 4]]>, numbers: usize) -> Self {
        let mut sums = Self {
            numbers: vec![0.0; 3 * numbers],
            inverse: 0.0,
            nearest: f64::INFINITY,
            behind: 0.0,
            sees: 0.0,
            counted: [0.0; 4],
        };
        for rows in chunks {
            for (sum, row) in sums.numbers.chunks_exact_mut(3).zip(rows) {
                sum.iter_mut().zip(row).for_each(|(sum, part)| *sum += f64::from(*part));
            }
            let [inverse, nearest, behind, sees] = rows[numbers].map(f64::from);
            sums.inverse += inverse;
            sums.behind += behind;
            sums.sees += sees;
            sums.nearest = sums.nearest.min(nearest);
            sums.counted.iter_mut().zip(rows[numbers + 1]).for_each(|(sum, part)| *sum += f64::from(part));
        }
        sums
    }
}
