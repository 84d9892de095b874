#include "service/solver/fourier.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

#include "service/solver/linear_operator.h"

namespace teletact::service {
namespace {

constexpr std::size_t kLargest = 512;

// exp(-2 pi i k / count), k = 0 .. count - 1.
template <class T>
std::vector<T> roots_of_one(std::size_t count) {
  std::vector<T> roots;
  for (std::size_t k = 0; k < count; ++k) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(count);
    roots.push_back(static_cast<T>(std::cos(angle)));
    roots.push_back(static_cast<T>(-std::sin(angle)));
  }
  return roots;
}

// Items of a work-group; 0 where there are to be none: on processors and where none can hold a whole line.
template <class T>
std::size_t group_of(const Queue& queue, FourierKernels kernels) {
  if (kernels == FourierKernels::kItems) return 0;
  if (kernels == FourierKernels::kOfDevice && !queue.info().gpu) return 0;
  const std::size_t group = std::min<std::size_t>(256, std::bit_floor(queue.info().max_group));
  return 4 * group < kLargest ? 0 : group;
}

}  // namespace

template <class T>
Fourier<T>::Fourier(const Queue& queue, std::size_t nx, std::size_t nz, std::size_t planes,
                    FourierKernels kernels)
    : nx_(nx), nz_(nz), planes_(planes) {
  if (!std::has_single_bit(nx) || !std::has_single_bit(nz) || nx < 2 || std::max(nx, nz) > kLargest)
    throw std::invalid_argument("fourier: planes of " + std::to_string(nx) + " x " + std::to_string(nz) +
                                " are not powers of two, 2 to 512 by 1 to 512");
  group_ = group_of<T>(queue, kernels);
  roots_ = queue.array(roots_of_one<T>(std::max(nx, nz)));
  defines_ = {{"NX", std::to_string(nx)}, {"NZ", std::to_string(nz)}};
  if (group_ > 0) {
    defines_["GROUP"] = std::to_string(group_);
    const auto get = [&](const char* name) {
      return queue.kernel("fourier_groups", name, precision_of<T>, defines_);
    };
    forward_ = get("rows_forward");
    backward_ = get("rows_backward");
    columns_ = get("columns");
  } else {
    const std::size_t width = std::min({std::bit_floor(queue.info().width<T>()), std::size_t{16}, nx / 2});
    at_once_ = std::max<std::size_t>(1, width / nz);
    defines_["WIDTH"] = std::to_string(width);
    forward_ = queue.kernel("fourier", "forward", precision_of<T>, defines_);
    backward_ = queue.kernel("fourier", "backward", precision_of<T>, defines_);
  }
}

template <class T>
void Fourier<T>::check(const Array<T>& field, const Array<T>& spectrum, std::size_t first,
                       std::size_t count) const {
  if (first > planes_ || count > planes_ - first)
    throw std::invalid_argument("fourier: " + std::to_string(count) + " planes from " +
                                std::to_string(first) + " on, of " + std::to_string(planes_));
  if (field.size() < field_size() || spectrum.size() < spectrum_size())
    throw std::invalid_argument("fourier: the field or the spectrum is too small for " +
                                std::to_string(planes_) + " planes");
}

template <class T>
Range Fourier<T>::over_rows(std::size_t count) const {
  if (group_ == 0) return {{(count + at_once_ - 1) / at_once_}, {1}};
  const std::size_t lines = 4 * group_ / (nx_ / 2);  // of a group
  return {{(count * nz_ + lines - 1) / lines * group_}, {group_}};
}

template <class T>
void Fourier<T>::rows(Kernel& kernel, const Array<T>& from, const Array<T>& to, std::size_t first,
                      std::size_t count) {
  kernel(over_rows(count), from, to, roots_, static_cast<int>(first), static_cast<int>(count));
}

template <class T>
void Fourier<T>::columns(Array<T>& spectrum, std::size_t first, std::size_t count, bool inverse) {
  if (group_ == 0 || count == 0 || nz_ == 1) return;  // or done with the rows
  const std::size_t columns = 4 * group_ / nz_, groups = (nx_ / 2 + columns) / columns;
  columns_({{groups * group_, count}, {group_}}, spectrum, roots_, static_cast<int>(first),
           static_cast<int>(inverse));
}

template <class T>
void Fourier<T>::forward(const Array<T>& field, Array<T>& spectrum, std::size_t first, std::size_t count) {
  check(field, spectrum, first, count);
  rows(forward_, field, spectrum, first, count);
  columns(spectrum, first, count, false);
}

template <class T>
void Fourier<T>::backward(Array<T>& spectrum, Array<T>& field, std::size_t first, std::size_t count) {
  check(field, spectrum, first, count);
  columns(spectrum, first, count, true);
  rows(backward_, spectrum, field, first, count);
}

template class Fourier<float>;
template class Fourier<double>;

}  // namespace teletact::service
