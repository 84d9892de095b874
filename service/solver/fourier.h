// Real two-dimensional discrete Fourier transforms of planes on the device.
//
// Field: [plane][z][x], real. Spectrum: [plane][part][kz][kx], parts real and imaginary, kx = 0 .. nx/2 and
// columns of zeros up to the pitch:
//   X(kx, kz) = sum over (x, z) of f(x, z) exp(-2 pi i (kx x / nx + kz z / nz)).
#pragma once

#include <cstddef>

#include "service/device/device.h"

namespace teletact::service {

enum class FourierKernels {
  kOfDevice,  // items on a processor, groups on a GPU
  kItems,     // one item a plane, vectors of many numbers, no barriers
  kGroups     // work-groups, local memory
};

// One thread at a time, as its queue.
template <class T>
class Fourier {
 public:
  // Throws std::invalid_argument unless nx is a power of two from 2 to 512, nz one from 1 to 512.
  Fourier(const Queue&, std::size_t nx, std::size_t nz, std::size_t planes,
          FourierKernels = FourierKernels::kOfDevice);
  std::size_t pitch() const { return (nx_ / 2 + 8) / 8 * 8; }  // numbers in a row of the spectrum
  std::size_t field_size() const { return planes_ * nz_ * nx_; }
  std::size_t spectrum_size() const { return planes_ * 2 * nz_ * pitch(); }
  // Of planes first .. first + count - 1; the others are left alone. Throws std::invalid_argument if there
  // are not so many planes, or an array is too small for all of them.
  void forward(const Array<T>& field, Array<T>& spectrum, std::size_t first, std::size_t count);
  // The inverse of forward, 1 / (nx nz) included; uses these planes of the spectrum up. It must be that of a
  // real field: X(kx, -kz) conjugate to X(kx, kz) at kx = 0 and nx/2.
  void backward(Array<T>& spectrum, Array<T>& field, std::size_t first, std::size_t count);
  // For kernels of work-groups, which include fourier_lines.clh.
  std::size_t group() const { return group_; }  // items in a work-group; 0: kernels of items
  const Defines& defines() const { return defines_; }
  const Array<T>& roots() const { return roots_; }
  Range over_rows(std::size_t count) const;  // of so many planes
  // Columns of planes whose rows are done, in place. Does nothing where items do both.
  void columns(Array<T>& spectrum, std::size_t first, std::size_t count, bool inverse);

 private:
  void check(const Array<T>& field, const Array<T>& spectrum, std::size_t first, std::size_t count) const;
  void rows(Kernel&, const Array<T>& from, const Array<T>& to, std::size_t first, std::size_t count);
  std::size_t nx_, nz_, planes_;
  std::size_t group_ = 0;
  std::size_t at_once_ = 1;  // planes of an item
  Defines defines_;
  Array<T> roots_;                       // kernels/fourier.clh
  Kernel forward_, backward_, columns_;  // of groups: of rows, rows, columns
};

}  // namespace teletact::service
