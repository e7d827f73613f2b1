//! The Embree device: options, errors and memory accounting.

use crate::error::{Error, Result};
use crate::memory::{Budget, Refusal};
use buffon_embree_sys as sys;
use std::ffi::{CStr, CString, c_char, c_void};
use std::ptr;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// The greatest number of threads of a device.
const MAX_THREADS: usize = 4096;

/// Returns the version of the Embree headers that Buffon was built with, e.g. `3.13.5`.
pub fn version() -> &'static str {
    let bytes: &'static [u8] = sys::RTC_VERSION_STRING;
    CStr::from_bytes_with_nul(bytes).ok().and_then(|s| s.to_str().ok()).unwrap_or("3")
}

/// The options of a device. They are typed because Embree silently accepts unknown option strings.
#[derive(Clone, Copy, Debug, Default)]
pub struct DeviceOptions {
    /// The number of threads that build scenes; 0 uses all cores. Embree has one limit per process, set by the last
    /// device.
    pub threads: usize,
    /// The highest instruction set that Embree uses, even if the CPU has a higher one.
    pub max_isa: Option<Isa>,
}

/// Instruction sets; each includes all before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// SSE up to 4.2: four lanes.
    Sse42,
    /// AVX: eight lanes.
    Avx,
    /// AVX2: eight lanes.
    Avx2,
    /// AVX-512: sixteen lanes.
    Avx512,
}

impl Isa {
    /// All instruction sets.
    pub const ALL: [Isa; 4] = [Isa::Sse42, Isa::Avx, Isa::Avx2, Isa::Avx512];

    /// Returns Embree's name of the instruction set.
    fn name(self) -> &'static str {
        match self {
            Isa::Sse42 => "sse4.2",
            Isa::Avx => "avx",
            Isa::Avx2 => "avx2",
            Isa::Avx512 => "avx512",
        }
    }
}

impl DeviceOptions {
    /// Returns the configuration string of `rtcNewDevice`.
    fn config(&self) -> Result<CString> {
        if self.threads > MAX_THREADS {
            let message = format!("expected at most {MAX_THREADS} threads, found {}", self.threads);
            return Err(Error::usage(message).about("Embree"));
        }
        let threads = (self.threads > 0).then(|| format!("threads={}", self.threads));
        let max_isa = self.max_isa.map(|isa| format!("max_isa={}", isa.name()));
        let text = threads.into_iter().chain(max_isa).collect::<Vec<_>>().join(",");
        Ok(CString::new(text).expect("the configuration has no NUL"))
    }
}

/// The state to which Embree's callbacks write.
struct CallbackState {
    bytes: AtomicIsize,
    messages: Mutex<Vec<String>>,
    budget: Budget,
    /// The first allocation that the budget rejected.
    refusal: Mutex<Option<Refusal>>,
}

/// An Embree device. Scenes made with it keep it alive.
pub struct Device {
    handle: Arc<DeviceHandle>,
}

/// The single owner of the C handle, shared by the device and its scenes.
pub(super) struct DeviceHandle {
    raw: sys::RTCDevice,
    state: Box<CallbackState>,
}

// SAFETY: Embree's device is thread-safe (reference-counted, internally locked); the callbacks only touch atomics and
// mutexes.
unsafe impl Send for DeviceHandle {}
// SAFETY: as above.
unsafe impl Sync for DeviceHandle {}

impl Device {
    /// Creates a device without a memory limit.
    ///
    /// # Errors
    /// As [`within`](Self::within).
    pub fn new(options: DeviceOptions) -> Result<Self> {
        Device::within(options, Budget::unlimited())
    }

    /// Creates a device. The memory of its scenes is charged to the budget; a build that exceeds the budget fails.
    ///
    /// # Errors
    /// If the options are out of range, or if Embree cannot run here (the error has Embree's message).
    pub fn within(options: DeviceOptions, budget: Budget) -> Result<Self> {
        let config = options.config()?;
        // SAFETY: `config` is a NUL-terminated string that outlives the call.
        let raw = unsafe { sys::rtcNewDevice(config.as_ptr()) };
        if raw.is_null() {
            // SAFETY: a null device is the documented way to ask why `rtcNewDevice` failed.
            let code = unsafe { sys::rtcGetDeviceError(ptr::null_mut()) };
            return Err(Error::internal(format!("cannot create an Embree device: {}", describe(code)))
                .about("Embree"));
        }
        let state = Box::new(CallbackState {
            bytes: AtomicIsize::new(0),
            messages: Mutex::new(Vec::new()),
            budget,
            refusal: Mutex::new(None),
        });
        let user: *const CallbackState = &*state;
        // SAFETY: `raw` is a live device. `state` is boxed, so its address is stable, and it is dropped by
        // `DeviceHandle` only after the device was released.
        unsafe {
            sys::rtcSetDeviceErrorFunction(raw, Some(on_error), user.cast_mut().cast());
            sys::rtcSetDeviceMemoryMonitorFunction(raw, Some(on_memory), user.cast_mut().cast());
        }
        let handle = Arc::new(DeviceHandle { raw, state });
        handle.check("making the device")?;
        Ok(Device { handle })
    }

    /// Bytes that Embree holds for this device and its scenes, as its memory monitor reports them. Shared vertex
    /// and index arrays are not included.
    pub fn memory_bytes(&self) -> usize {
        self.handle.memory_bytes()
    }

    /// Returns whether packets of 16 rays are traced with 16 lanes on this machine.
    pub fn has_native_packets16(&self) -> bool {
        self.handle.has_native_packets16()
    }

    /// Returns the shared owner of the handle.
    pub(super) fn handle(&self) -> &Arc<DeviceHandle> {
        &self.handle
    }
}

impl DeviceHandle {
    /// Returns the C handle, which is valid while `self` lives.
    pub(super) fn raw(&self) -> sys::RTCDevice {
        self.raw
    }

    /// See [`Device::has_native_packets16`].
    pub(super) fn has_native_packets16(&self) -> bool {
        let property = sys::RTCDeviceProperty::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED;
        // SAFETY: the device is live, the property exists in every Embree 3.
        unsafe { sys::rtcGetDeviceProperty(self.raw, property) != 0 }
    }

    /// See [`Device::memory_bytes`].
    pub(super) fn memory_bytes(&self) -> usize {
        self.state.bytes.load(Ordering::Relaxed).max(0) as usize
    }

    /// Reads and clears this thread's error; `doing` names the operation for the message.
    pub(super) fn check(&self, doing: &str) -> Result<()> {
        // SAFETY: the device is live.
        let code = unsafe { sys::rtcGetDeviceError(self.raw) };
        let mut messages = self.state.messages.lock().unwrap_or_else(PoisonError::into_inner);
        if code == sys::RTCError::RTC_ERROR_NONE {
            return Ok(());
        }
        let detail = messages.drain(..).collect::<Vec<_>>().join("; ");
        let refusal = self.state.refusal.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(refusal) = refusal.filter(|_| code == sys::RTCError::RTC_ERROR_OUT_OF_MEMORY) {
            let what = "one more part of the acceleration structure";
            return Err(Error::scene(refusal.sentence(what, "use fewer triangles")).about("Embree"));
        }
        let detail = if detail.is_empty() { String::new() } else { format!(" ({detail})") };
        Err(Error::internal(format!("{doing}: {}{detail}", describe(code))).about("Embree"))
    }
}

impl Drop for DeviceHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is live and owned by `self` alone; scenes hold an `Arc` of `self`, so none is left.
        // The callback state is a field and is dropped after this.
        unsafe { sys::rtcReleaseDevice(self.raw) };
    }
}

/// Describes an error code.
fn describe(code: sys::RTCError) -> &'static str {
    match code {
        sys::RTCError::RTC_ERROR_NONE => "no error",
        sys::RTCError::RTC_ERROR_INVALID_ARGUMENT => "invalid argument",
        sys::RTCError::RTC_ERROR_INVALID_OPERATION => "invalid operation",
        sys::RTCError::RTC_ERROR_OUT_OF_MEMORY => "out of memory",
        sys::RTCError::RTC_ERROR_UNSUPPORTED_CPU => "this CPU is not supported",
        sys::RTCError::RTC_ERROR_CANCELLED => "cancelled",
        _ => "unknown error",
    }
}

/// Embree's error callback: stores the message until [`DeviceHandle::check`] reads the code.
unsafe extern "C" fn on_error(user: *mut c_void, _code: sys::RTCError, text: *const c_char) {
    if user.is_null() || text.is_null() {
        return;
    }
    // SAFETY: `user` is the `CallbackState` that `Device::within` registered; it outlives the device.
    let state = unsafe { &*user.cast::<CallbackState>() };
    // SAFETY: Embree passes a NUL-terminated string that lives for the call.
    let text = unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned();
    state.messages.lock().unwrap_or_else(PoisonError::into_inner).push(text);
}

/// Embree's memory monitor: counts allocations (`bytes` > 0; `post` if already done) and deallocations, and rejects
/// allocations that exceed the budget.
unsafe extern "C" fn on_memory(user: *mut c_void, bytes: isize, post: bool) -> bool {
    if user.is_null() {
        return true;
    }
    // SAFETY: `user` is the `CallbackState` that `Device::within` registered; it outlives the device.
    let state = unsafe { &*user.cast::<CallbackState>() };
    let amount = bytes.unsigned_abs() as u64;
    if bytes < 0 {
        state.budget.refund(amount);
    } else if let Err(refusal) = state.budget.charge(amount) {
        state.refusal.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(refusal);
        if post {
            // Embree will report the deallocation of the memory that it already has.
            state.budget.record(amount);
            state.bytes.fetch_add(bytes, Ordering::Relaxed);
        }
        return false;
    }
    state.bytes.fetch_add(bytes, Ordering::Relaxed);
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_many_threads_are_refused_in_a_sentence() {
        let error =
            Device::new(DeviceOptions { threads: 5000, ..DeviceOptions::default() }).err().expect("refused");
        assert_eq!(error.to_string(), "Embree: expected at most 4096 threads, found 5000");
    }

    #[test]
    fn a_device_says_what_it_is() {
        let device = Device::new(DeviceOptions::default()).expect("a device");
        assert!(version().starts_with("3."));
        let _ = device.has_native_packets16();
    }
}
