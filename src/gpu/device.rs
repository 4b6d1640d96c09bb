use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use wgpu::util::DeviceExt;

/// Which adapters may be opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AdapterKind {
    /// The fastest kind that is there: discrete, integrated, virtual, other, software.
    #[default]
    Any,
    /// Only real devices.
    Hardware,
    /// Only software devices (type `Cpu`), whose timings are no GPU timings.
    Software,
}

/// No adapter of the wanted kind can be used, and what to do about it.
#[derive(Clone, Debug, thiserror::Error)]
pub enum NoGpu {
    #[error(
        "no Vulkan adapter was found: install the graphics card's Vulkan driver, or for a software adapter the Debian package mesa-vulkan-drivers"
    )]
    NoAdapter,
    #[error("no {wanted} Vulkan adapter was found, only {found}")]
    WrongKind { wanted: &'static str, found: String },
    #[error("the Vulkan adapter {adapter} gives no device: {reason}")]
    NoDevice { adapter: String, reason: String },
}

/// What went wrong in one piece of work on an open device. It fails that work alone, except [`GpuError::Lost`].
#[derive(Clone, Debug, thiserror::Error)]
pub enum GpuError {
    #[error("the GPU device was lost during {during}: {reason}")]
    Lost { during: String, reason: String },
    #[error("the GPU ran out of memory during {during}")]
    OutOfMemory { during: String },
    #[error("the GPU refused {during}: {reason}")]
    Refused { during: String, reason: String },
    #[error("{what} takes {needed}, the adapter's limit is {limit}")]
    TooLarge { what: &'static str, needed: u64, limit: u64 },
    #[error("{during} did not finish within {seconds} s on the GPU")]
    Timeout { during: String, seconds: u64 },
    #[error("the GPU's clocks gave no positive time for {during}: too little work to time")]
    NotTimed { during: String },
}

/// What an adapter is, for provenance and for telling software from hardware.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct AdapterDescription {
    pub name: String,
    pub driver: String,
    /// The driver's version, as it words it (Mesa's on a software adapter: pictures of it depend on that).
    pub driver_info: String,
    pub backend: String,
    pub device_type: String,
    /// A processor plays the GPU: the answers hold, the timings are no GPU timings.
    pub software: bool,
    /// The features of [`GpuFeatures`] that it has.
    pub features: GpuFeatures,
    pub limits: GpuLimits,
}

/// The optional features that this crate uses where they are there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct GpuFeatures {
    /// Timestamps at the ends of passes; without them the wall clock times.
    pub timestamp_query: bool,
    /// Filtered reads of 32-bit textures; without it volume textures are 16-bit.
    pub float32_filterable: bool,
}

/// The limits that bound the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct GpuLimits {
    pub max_storage_buffer_binding_size: u64,
    pub max_buffer_size: u64,
    pub max_texture_dimension_3d: u32,
    pub max_sampled_textures_per_shader_stage: u32,
    pub max_compute_workgroups_per_dimension: u32,
}

impl AdapterDescription {
    fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let (features, limits) = (adapter.features(), adapter.limits());
        Self {
            software: info.device_type == wgpu::DeviceType::Cpu,
            device_type: format!("{:?}", info.device_type),
            backend: info.backend.to_string(),
            name: info.name,
            driver: info.driver,
            driver_info: info.driver_info,
            features: GpuFeatures {
                timestamp_query: features.contains(wgpu::Features::TIMESTAMP_QUERY),
                float32_filterable: features.contains(wgpu::Features::FLOAT32_FILTERABLE),
            },
            limits: GpuLimits {
                max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
                max_buffer_size: limits.max_buffer_size,
                max_texture_dimension_3d: limits.max_texture_dimension_3d,
                max_sampled_textures_per_shader_stage: limits.max_sampled_textures_per_shader_stage,
                max_compute_workgroups_per_dimension: limits.max_compute_workgroups_per_dimension,
            },
        }
    }

    /// The adapter as results and figures name it; a software adapter says so.
    pub fn label(&self) -> String {
        if self.software { format!("{} (software)", self.name) } else { self.name.clone() }
    }

    /// Lower is preferred.
    fn rank(&self) -> u8 {
        match self.device_type.as_str() {
            "DiscreteGpu" => 0,
            "IntegratedGpu" => 1,
            "VirtualGpu" => 2,
            "Cpu" => 4,
            _ => 3,
        }
    }
}

/// An open device without a window. Clones share it. Use it from one thread at a time.
#[derive(Clone, Debug)]
pub struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) timestamp_period: Option<f64>,
    adapter: Arc<AdapterDescription>,
    lost: Arc<Mutex<Option<String>>>,
}

/// No single wait on the device is longer than this.
const PATIENCE: Duration = Duration::from_secs(60);

/// Mesa's device-selection layer asks for a Wayland display, and libwayland complains on standard error where
/// XDG_RUNTIME_DIR is not set. Any folder silences it.
fn silence_wayland() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
            // SAFETY: a race needs foreign code that reads the environment in another thread at this moment. Rust's own
            // readers share a lock with this call, and the only foreign code here, the driver, starts after it.
            unsafe { std::env::set_var("XDG_RUNTIME_DIR", std::env::temp_dir()) };
        }
    });
}

fn instance() -> wgpu::Instance {
    silence_wayland();
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN;
    // No validation layers and no labels for them: their time would be measured.
    descriptor.flags = wgpu::InstanceFlags::empty();
    wgpu::Instance::new(descriptor)
}

fn adapters(instance: &wgpu::Instance) -> Vec<(AdapterDescription, wgpu::Adapter)> {
    let mut found: Vec<_> = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN))
        .into_iter()
        .map(|adapter| (AdapterDescription::of(&adapter), adapter))
        .collect();
    found.sort_by_key(|(description, _)| description.rank());
    found
}

impl Gpu {
    /// Every adapter of this machine, the preferred one first. Empty without a driver.
    pub fn adapters() -> Vec<AdapterDescription> {
        adapters(&instance()).into_iter().map(|(description, _)| description).collect()
    }

    /// Opens the preferred adapter of a kind.
    pub fn open(kind: AdapterKind) -> Result<Self, NoGpu> {
        let instance = instance();
        let all = adapters(&instance);
        let found = all.iter().map(|(description, _)| description.label()).collect::<Vec<_>>().join(", ");
        if all.is_empty() {
            return Err(NoGpu::NoAdapter);
        }
        let (wanted, fits): (_, fn(&AdapterDescription) -> bool) = match kind {
            AdapterKind::Any => ("usable", |_| true),
            AdapterKind::Hardware => ("hardware", |adapter| !adapter.software),
            AdapterKind::Software => ("software", |adapter| adapter.software),
        };
        let mut refusal = NoGpu::WrongKind { wanted, found };
        for (description, adapter) in all.into_iter().filter(|(description, _)| fits(description)) {
            match Self::from_adapter(description, &adapter) {
                Ok(gpu) => return Ok(gpu),
                Err(error) => refusal = error,
            }
        }
        Err(refusal)
    }

    fn from_adapter(description: AdapterDescription, adapter: &wgpu::Adapter) -> Result<Self, NoGpu> {
        let mut features = wgpu::Features::empty();
        features.set(wgpu::Features::TIMESTAMP_QUERY, description.features.timestamp_query);
        features.set(wgpu::Features::FLOAT32_FILTERABLE, description.features.float32_filterable);
        // Portable defaults, and as much memory a binding as there is.
        let limits = wgpu::Limits {
            max_storage_buffer_binding_size: description.limits.max_storage_buffer_binding_size,
            max_buffer_size: description.limits.max_buffer_size,
            ..wgpu::Limits::default()
        };
        let request = wgpu::DeviceDescriptor {
            label: Some("rigbench"),
            required_features: features,
            required_limits: limits,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&request))
            .map_err(|error| NoGpu::NoDevice { adapter: description.label(), reason: error.to_string() })?;
        let lost = Arc::new(Mutex::new(None));
        let on_loss = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, message| {
            *on_loss.lock().unwrap() = Some(format!("{reason:?}: {message}"));
        });
        // Outside of `checked` nothing should fail; what does is kept as a loss of the device and never panics.
        let uncaptured = Arc::clone(&lost);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            uncaptured.lock().unwrap().get_or_insert(error.to_string());
        }));
        let timestamp_period =
            description.features.timestamp_query.then(|| f64::from(queue.get_timestamp_period())).filter(|p| *p > 0.0);
        Ok(Self { device, queue, timestamp_period, adapter: Arc::new(description), lost })
    }

    pub fn adapter(&self) -> &AdapterDescription {
        &self.adapter
    }

    /// Whether this device still works.
    pub fn is_lost(&self) -> bool {
        self.lost.lock().unwrap().is_some()
    }

    /// Gives the device up: all later work fails with [`GpuError::Lost`].
    pub fn close(&self) {
        self.device.destroy();
        let _ = self.device.poll(wgpu::PollType::Poll);
        self.lost.lock().unwrap().get_or_insert_with(|| "it was closed".to_owned());
    }

    /// Does some work under error scopes: what the device reports becomes the error of this work.
    pub(super) fn checked<T>(&self, during: &str, work: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
        self.still_there(during)?;
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let done = work();
        let internal = pollster::block_on(internal.pop());
        let validation = pollster::block_on(validation.pop());
        let memory = pollster::block_on(memory.pop());
        self.still_there(during)?;
        if memory.is_some() {
            return Err(GpuError::OutOfMemory { during: during.to_owned() });
        }
        if let Some(error) = validation.or(internal) {
            return Err(GpuError::Refused { during: during.to_owned(), reason: error.to_string() });
        }
        done
    }

    fn still_there(&self, during: &str) -> Result<(), GpuError> {
        match &*self.lost.lock().unwrap() {
            Some(reason) => Err(GpuError::Lost { during: during.to_owned(), reason: reason.clone() }),
            None => Ok(()),
        }
    }

    /// Waits until everything that was submitted is done.
    pub(super) fn wait(&self, during: &str) -> Result<(), GpuError> {
        match self.device.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) }) {
            Ok(_) => self.still_there(during),
            Err(wgpu::PollError::Timeout) => {
                Err(GpuError::Timeout { during: during.to_owned(), seconds: PATIENCE.as_secs() })
            }
            Err(error) => Err(GpuError::Lost { during: during.to_owned(), reason: error.to_string() }),
        }
    }

    /// The wall-clock time from now until everything submitted is done.
    pub(super) fn timed_wait(&self, during: &str) -> Result<Duration, GpuError> {
        let start = Instant::now();
        self.wait(during)?;
        Ok(start.elapsed())
    }

    /// A storage buffer with contents; an empty one gets some zeros, because a binding holds one element at least.
    pub(super) fn storage(&self, what: &'static str, contents: &[u8]) -> Result<wgpu::Buffer, GpuError> {
        self.fits_binding(what, contents.len() as u64)?;
        let contents = if contents.is_empty() { &[0; 64] } else { contents };
        Ok(self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(what),
            contents,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        }))
    }

    /// A storage buffer that is written by shaders and read back.
    pub(super) fn output(&self, what: &'static str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        self.fits_binding(what, bytes)?;
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(what),
            size: bytes.max(16),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        }))
    }

    fn fits_binding(&self, what: &'static str, bytes: u64) -> Result<(), GpuError> {
        let limit = self.device.limits().max_storage_buffer_binding_size;
        if bytes > limit { Err(GpuError::TooLarge { what, needed: bytes, limit }) } else { Ok(()) }
    }

    /// The first `bytes` of a buffer, after everything that was submitted.
    pub(super) fn read(&self, buffer: &wgpu::Buffer, bytes: u64, during: &str) -> Result<Vec<u8>, GpuError> {
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
        self.queue.submit([encoder.finish()]);
        let (sender, mapped) = std::sync::mpsc::channel();
        staging.slice(..).map_async(wgpu::MapMode::Read, move |result| {
            let _ = sender.send(result);
        });
        self.wait(during)?;
        let refused = |reason: String| GpuError::Refused { during: during.to_owned(), reason };
        mapped.recv().map_err(|error| refused(error.to_string()))?.map_err(|error| refused(error.to_string()))?;
        let view = staging.slice(..).get_mapped_range().map_err(|error| refused(error.to_string()))?;
        Ok(view.to_vec())
    }
}
