use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The disk would not do as it was told.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot {action}: {cause}", path.display())]
pub struct StoreError {
    pub path: PathBuf,
    pub action: &'static str,
    #[source]
    pub cause: std::io::Error,
}

impl StoreError {
    pub fn new(path: &Path, action: &'static str, cause: std::io::Error) -> Self {
        Self { path: path.to_owned(), action, cause }
    }
}

/// Names of files that are being written begin so; what a killed process left behind is known by it.
pub(super) const UNFINISHED: &str = ".unfinished-";

/// Writes a whole file or nothing: into a file of another name in the same folder, then renamed.
/// A reader sees the old content or the new, at any moment of a kill. The folder is made if it is not there.
/// Nothing is flushed to the disk: after a power cut a file may be cut short, which its own hash then shows, and a sweep of
/// thousands of runs would wait for the disk most of its time.
pub fn write_atomic(path: &Path, content: &[u8]) -> Result<(), StoreError> {
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    create_folder(folder)?;
    let write = || {
        let mut file = unfinished_file(folder)?;
        file.write_all(content)?;
        file.persist(path).map_err(|e| e.error).map(drop)
    };
    write().map_err(|cause| StoreError::new(path, "write", cause))
}

/// A file beside the one that it will become, with the permissions of any new file.
fn unfinished_file(folder: &Path) -> std::io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(UNFINISHED);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666)); // less what the umask takes away
    }
    builder.tempfile_in(folder)
}

pub(super) fn create_folder(folder: &Path) -> Result<(), StoreError> {
    std::fs::create_dir_all(folder).map_err(|cause| StoreError::new(folder, "create the folder", cause))
}

/// Removes a file; one that is not there is removed already.
pub(super) fn remove(path: &Path) -> Result<(), StoreError> {
    match std::fs::remove_file(path) {
        Err(cause) if cause.kind() != std::io::ErrorKind::NotFound => Err(StoreError::new(path, "remove", cause)),
        _ => Ok(()),
    }
}

/// Removes what a killed process left half written in a folder. The caller holds the folder's lock.
pub(super) fn remove_unfinished(folder: &Path) -> Result<(), StoreError> {
    let entries = std::fs::read_dir(folder).map_err(|cause| StoreError::new(folder, "read the folder", cause))?;
    for entry in entries.flatten() {
        if entry.file_name().to_string_lossy().starts_with(UNFINISHED) {
            remove(&entry.path())?;
        }
    }
    Ok(())
}

/// An exclusive lock between processes, held until it is dropped; the system frees it when its process dies.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

impl Lock {
    /// Takes the lock if no one holds it.
    pub fn try_take(path: &Path) -> Result<Option<Self>, StoreError> {
        let file = Self::open(path)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Self { _file: file })),
            Err(std::fs::TryLockError::WouldBlock) => Ok(None),
            Err(std::fs::TryLockError::Error(cause)) => Err(StoreError::new(path, "lock", cause)),
        }
    }

    /// Waits until the lock is free and takes it.
    pub fn take(path: &Path) -> Result<Self, StoreError> {
        let file = Self::open(path)?;
        file.lock().map_err(|cause| StoreError::new(path, "lock", cause))?;
        Ok(Self { _file: file })
    }

    fn open(path: &Path) -> Result<File, StoreError> {
        if let Some(folder) = path.parent() {
            create_folder(folder)?;
        }
        File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path)
            .map_err(|cause| StoreError::new(path, "open the lock", cause))
    }
}
