// What the OpenCL runtime needs from the process before the first call into it.
#pragma once

namespace teletact::service {

// PoCL aborts without /proc and /sys and fails or crashes without a writable kernel cache folder: throws
// DeviceError naming what is missing and the remedy. Does nothing where PoCL is not installed.
void check_runtime_environment();

}  // namespace teletact::service
