#include "service/device/environment.h"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

#include "service/device/device.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

// OCL_ICD_VENDORS names a folder, an .icd file or a library; by default the system's folder of .icd files.
bool pocl_is_installed() {
  const std::string vendors = environment("OCL_ICD_VENDORS");
  const fs::path place = vendors.empty() ? "/etc/OpenCL/vendors" : vendors;
  std::error_code error;
  if (!fs::is_directory(place, error)) return place.string().find("pocl") != std::string::npos;
  for (const auto& entry : fs::directory_iterator(place, error)) {
    std::ifstream file(entry.path());
    std::string library;
    std::getline(file, library);
    if (library.find("pocl") != std::string::npos) return true;
  }
  return false;
}

// Where PoCL 3.1 keeps compiled kernels. It takes an empty HOME for the root folder.
fs::path pocl_cache() {
  if (const char* set = std::getenv("POCL_CACHE_DIR")) {
    if (*set == 0)  // PoCL aborts
      throw DeviceError("POCL_CACHE_DIR is set but empty: give a writable folder, or unset it");
    return set;
  }
  if (const std::string set = environment("XDG_CACHE_HOME"); !set.empty())
    return fs::path(set) / "pocl/kcache";
  if (const char* home = std::getenv("HOME")) return std::string(home) + "/.cache/pocl/kcache";
  return "/tmp/pocl/kcache";
}

bool can_write_in(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  std::string probe = (folder / "teletact-XXXXXX").string();
  const int file = mkstemp(probe.data());
  if (file < 0) return false;
  close(file);
  unlink(probe.c_str());
  return true;
}

}  // namespace

std::string no_device() {
  std::string set;
  for (const char* name : {"OCL_ICD_VENDORS", "OCL_ICD_FILENAMES", "POCL_DEVICES"})
    if (const char* value = std::getenv(name))
      set += std::string(set.empty() ? "" : ", ") + name + "=" + std::string(value).substr(0, 200);
  return "no OpenCL device: " + (set.empty() ? "" : "check or unset " + set + "; or ") +
         "install an OpenCL driver (Debian: pocl-opencl-icd)";
}

void check_runtime_environment() {
  if (!pocl_is_installed()) return;
  std::error_code error;
  for (const char* needed : {"/proc/self", "/sys/devices/system/cpu"})
    if (!fs::exists(needed, error))
      throw DeviceError(std::string("the OpenCL runtime PoCL needs ") + needed +
                        ": mount /proc and /sys in this container or chroot");
  const fs::path cache = pocl_cache();
  if (!can_write_in(cache))
    throw DeviceError("the OpenCL kernel cache folder " + cache.string() +
                      " cannot be written: set POCL_CACHE_DIR to a writable folder");
}

}  // namespace teletact::service
