//! Advice to the operating system about memory. No result depends on it.

/// Asks for pages of 2 MiB where the system has them: a large table that is about to be filled then costs one missing
/// page for every 512, and looks all over it miss the processor's page cache less often. Call it before the first write.
///
/// ```
/// let mut table = vec![0u64; 1 << 20];
/// senda_core::memory::prefer_large_pages(&mut table);
/// assert!(table.iter().all(|value| *value == 0));
/// ```
#[cfg(target_os = "linux")]
pub fn prefer_large_pages<T>(table: &mut [T]) {
    use std::ffi::{c_int, c_void};
    unsafe extern "C" {
        fn madvise(start: *mut c_void, length: usize, advice: c_int) -> c_int;
    }
    /// `MADV_HUGEPAGE`.
    const LARGE: c_int = 14;
    /// The largest that Linux uses as its normal page: what is aligned to it is aligned to all.
    const PAGE: usize = 1 << 16;
    let start = table.as_mut_ptr().cast::<u8>();
    let skipped = (start as usize).next_multiple_of(PAGE) - start as usize;
    let length = size_of_val(table).saturating_sub(skipped) / PAGE * PAGE;
    if length >= 1 << 21 {
        // SAFETY: whole pages within memory that is borrowed for writing; the advice changes no byte of it.
        unsafe { madvise(start.wrapping_add(skipped).cast(), length, LARGE) };
    }
}

/// Only Linux takes the advice.
#[cfg(not(target_os = "linux"))]
pub fn prefer_large_pages<T>(_: &mut [T]) {}
