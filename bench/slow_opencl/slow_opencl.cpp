// A GPU's latency on a processor, for any program that is started with this as LD_PRELOAD: 6 us more an
// enqueue, 15 us more a call that waits (GpuModel).
#define CL_TARGET_OPENCL_VERSION 300
#include <CL/cl.h>
#include <dlfcn.h>

#include <chrono>

#include "bench/basics/gpu_model.h"

namespace {

void spend(bool waits) {
  const std::chrono::duration<double> more(waits ? teletact::bench::GpuModel{}.wait_s
                                                 : teletact::bench::GpuModel{}.launch_s);
  const auto begin = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() - begin < more) {
  }
}

}  // namespace

// The call of the same name in the library that this stands before.
#define THE_REAL(name) reinterpret_cast<decltype(&(name))>(dlsym(RTLD_NEXT, #name))

extern "C" {

cl_int clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions,
                              const size_t* offset, const size_t* global, const size_t* local, cl_uint count,
                              const cl_event* after, cl_event* event) {
  static const auto real = THE_REAL(clEnqueueNDRangeKernel);
  spend(false);
  return real(queue, kernel, dimensions, offset, global, local, count, after, event);
}

cl_int clEnqueueCopyBuffer(cl_command_queue queue, cl_mem from, cl_mem to, size_t from_offset,
                           size_t to_offset, size_t bytes, cl_uint count, const cl_event* after,
                           cl_event* event) {
  static const auto real = THE_REAL(clEnqueueCopyBuffer);
  spend(false);
  return real(queue, from, to, from_offset, to_offset, bytes, count, after, event);
}

cl_int clEnqueueFillBuffer(cl_command_queue queue, cl_mem buffer, const void* pattern, size_t pattern_bytes,
                           size_t offset, size_t bytes, cl_uint count, const cl_event* after,
                           cl_event* event) {
  static const auto real = THE_REAL(clEnqueueFillBuffer);
  spend(false);
  return real(queue, buffer, pattern, pattern_bytes, offset, bytes, count, after, event);
}

cl_int clEnqueueWriteBuffer(cl_command_queue queue, cl_mem buffer, cl_bool waits, size_t offset, size_t bytes,
                            const void* host, cl_uint count, const cl_event* after, cl_event* event) {
  static const auto real = THE_REAL(clEnqueueWriteBuffer);
  spend(waits == CL_TRUE);
  return real(queue, buffer, waits, offset, bytes, host, count, after, event);
}

cl_int clEnqueueReadBuffer(cl_command_queue queue, cl_mem buffer, cl_bool waits, size_t offset, size_t bytes,
                           void* host, cl_uint count, const cl_event* after, cl_event* event) {
  static const auto real = THE_REAL(clEnqueueReadBuffer);
  spend(waits == CL_TRUE);
  return real(queue, buffer, waits, offset, bytes, host, count, after, event);
}

cl_int clFinish(cl_command_queue queue) {
  static const auto real = THE_REAL(clFinish);
  spend(true);
  return real(queue);
}

cl_int clWaitForEvents(cl_uint count, const cl_event* events) {
  static const auto real = THE_REAL(clWaitForEvents);
  spend(true);
  return real(count, events);
}

}  // extern "C"
