// What the OpenCL runtime needs from the process before the first call into it.
#pragma once

#include <string>

namespace teletact::service {

// PoCL aborts without /proc and /sys and fails or crashes without a writable kernel cache folder: throws
// DeviceError naming what is missing and the remedy. Does nothing where PoCL is not installed.
void check_runtime_environment();

// That there is no device, with the remedy: a driver, or a variable that keeps one away.
std::string no_device();

}  // namespace teletact::service
