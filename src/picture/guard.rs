//! What a picture's file may promise before it is believed: a header of a few bytes must not make a reader ask for gigabytes.

use std::io::Cursor;

use exr::meta::MetaData;
use image::codecs::hdr::HdrDecoder;

/// The most pixels that are read.
const MOST_PIXELS: u64 = 1 << 28;

/// Bytes of pixels a byte of file: more than any of the compressions reaches.
const DENSEST: u64 = 4096;

fn believable(what: &str, width: u64, height: u64, bytes_a_pixel: u64, file: usize) -> Result<(), String> {
    let pixels = width.saturating_mul(height);
    if pixels > MOST_PIXELS {
        return Err(format!("{what}: {width} x {height} pixels; at most {MOST_PIXELS} are read"));
    }
    if pixels.saturating_mul(bytes_a_pixel) > DENSEST * file as u64 + (1 << 16) {
        return Err(format!("{what}: {width} x {height} pixels in a file of {file} bytes; it is cut short"));
    }
    Ok(())
}

/// Whether an OpenEXR file's headers promise no more than the file can hold.
pub fn exr_is_believable(bytes: &[u8]) -> Result<(), String> {
    let what = "not a whole OpenEXR file";
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| format!("{what}: {e}"))?;
    for header in &meta.headers {
        let size = header.layer_size;
        believable(what, size.0 as u64, size.1 as u64, header.channels.bytes_per_pixel as u64, bytes.len())?;
        if header.chunk_count > bytes.len() {
            return Err(format!("{what}: {} blocks in {} bytes", header.chunk_count, bytes.len()));
        }
    }
    Ok(())
}

/// Whether a Radiance file's header promises no more than the file can hold.
pub fn hdr_is_believable(bytes: &[u8]) -> Result<(), String> {
    let what = "not a whole Radiance .hdr file";
    let header = HdrDecoder::new(Cursor::new(bytes)).map_err(|e| format!("{what}: {e}"))?.metadata();
    believable(what, header.width.into(), header.height.into(), 12, bytes.len())
}
