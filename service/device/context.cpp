// Programs of one device: built once, kept in memory and on disk.
#include <atomic>

#include "service/device/opencl.h"
#include "service/device/program.h"

namespace teletact::service {
namespace {

// The line of a build log that says what is wrong.
std::string first_error(const std::string& log) {
  std::string first;
  for (std::size_t begin = 0; begin < log.size();) {
    std::size_t end = log.find('\n', begin);
    if (end == std::string::npos) end = log.size();
    const std::string line = log.substr(begin, end - begin);
    if (line.find("error") != std::string::npos) return line;
    if (first.empty()) first = line;
    begin = end + 1;
  }
  return first;
}

std::string cache_key(const DeviceInfo& info, const std::string& options, const std::string& source) {
  return info.platform + '\n' + info.name + '\n' + info.vendor + '\n' + info.version + '\n' +
         info.driver_version + '\n' + options + '\n' + source;
}

cl::Program from_binary(const cl::Context& context, const cl::Device& device,
                        const std::vector<unsigned char>& binary, const std::string& options) {
  cl::Program program(context, {device}, cl::Program::Binaries{binary});
  program.build(device, options.c_str());
  return program;
}

cl::Program from_source(const cl::Context& context, const cl::Device& device, const std::string& name,
                        const std::string& source, const std::string& options) {
  cl::Program program(context, source);
  try {
    program.build(device, options.c_str());
  } catch (const cl::Error& e) {
    std::string log;
    if (e.err() == CL_BUILD_PROGRAM_FAILURE) log = program.getBuildInfo<CL_PROGRAM_BUILD_LOG>(device);
    throw DeviceError("kernel program " + name + ".cl does not build (" + std::to_string(e.err()) +
                      "): " + first_error(log));
  }
  return program;
}

std::atomic<std::size_t> steps{0};

cl::Program build(const cl::Context& context, const cl::Device& device, const DeviceInfo& info,
                  const DeviceOptions& options, const std::string& name, const std::string& flags) {
  count_compile_step();
  const std::string source = program_source(name, options.kernel_directory);
  // PoCL keeps its own, and would compile every kernel once more, for any size of launch, to hand a binary
  // out.
  const bool kept = options.cache_directory.empty() && info.platform == kPocl;
  const BinaryCache cache(kept ? "none" : options.cache_directory);
  const std::string key = cache_key(info, flags, source);
  if (const auto binary = cache.load(key)) try {
      return from_binary(context, device, *binary, flags);
    } catch (const cl::Error&) {  // a driver that no longer takes its own binary: a miss
    }
  const cl::Program program = from_source(context, device, name, source, flags);
  if (cache.path(key).empty()) return program;
  try {
    const auto binaries = program.getInfo<CL_PROGRAM_BINARIES>();
    if (binaries.size() == 1) cache.store(key, binaries[0]);
  } catch (const cl::Error&) {  // a driver without binaries: nothing to keep
  }
  return program;
}

}  // namespace

std::size_t compile_steps() {
  return steps;
}

void count_compile_step() {
  ++steps;
}

Context::Context(cl::Device device, DeviceInfo info, DeviceOptions options)
    : device_(std::move(device)),
      info_(std::move(info)),
      options_(std::move(options)),
      context_(guarded("opening " + info_.name, [&] { return cl::Context(device_); })) {}

cl::Kernel Context::kernel(const std::string& source, const std::string& name, Precision precision,
                           const Defines& defines) {
  if (precision == Precision::kDouble && !info_.has_double)
    throw DeviceError("device " + info_.name + " has no double precision: choose float or refined");
  const std::string flags = program_options(precision, defines);
  const std::lock_guard lock(mutex_);
  auto found = programs_.find(source + '\n' + flags);
  if (found == programs_.end())
    found = programs_
                .emplace(source + '\n' + flags,
                         guarded("building kernel program " + source,
                                 [&] { return build(context_, device_, info_, options_, source, flags); }))
                .first;
  return guarded("kernel " + name + " of " + source, [&] { return cl::Kernel(found->second, name.c_str()); });
}

}  // namespace teletact::service
