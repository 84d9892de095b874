// Fourier transforms on the device against sums in double.
#include "service/solver/fourier.h"

#include <gtest/gtest.h>

#include <complex>
#include <numbers>

#include "tests/solver/block_stencil.h"

namespace teletact::service {
namespace {

using Complex = std::complex<double>;

struct Size {
  std::size_t nx, nz, planes;
};

// Sums of `count` numbers, `step` apart from `at` on, times exp(-2 pi i k n / count).
std::vector<Complex> sums(const std::vector<Complex>& values, std::size_t at, std::size_t step,
                          std::size_t count) {
  std::vector<Complex> roots(count), result(count);
  for (std::size_t k = 0; k < count; ++k)
    roots[k] = std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(count));
  for (std::size_t k = 0; k < count; ++k) {
    double real = 0,
           imaginary = 0;  // a product of two Complex looks for infinities, which takes most of the time
    for (std::size_t n = 0, turn = 0; n < count; ++n) {
      const Complex value = values[at + n * step], root = roots[turn];
      real += value.real() * root.real() - value.imag() * root.imag();
      imaginary += value.real() * root.imag() + value.imag() * root.real();
      turn += k;
      if (turn >= count) turn -= count;
    }
    result[k] = {real, imaginary};
  }
  return result;
}

// Of one plane, [kz][kx] with all kx.
std::vector<Complex> plain_transform(const double* plane, std::size_t nx, std::size_t nz) {
  std::vector<Complex> values(plane, plane + nx * nz);
  for (std::size_t z = 0; z < nz; ++z) {
    const auto row = sums(values, z * nx, 1, nx);
    std::copy(row.begin(), row.end(), values.begin() + static_cast<long>(z * nx));
  }
  for (std::size_t x = 0; x < nx; ++x) {
    const auto column = sums(values, x, nx, nz);
    for (std::size_t z = 0; z < nz; ++z) values[z * nx + x] = column[z];
  }
  return values;
}

std::vector<double> random_field(std::size_t size) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<double> field(size);
  for (double& value : field) value = uniform(random);
  return field;
}

template <class T>
struct OnDevice {
  OnDevice(const Size& size, FourierKernels kernels)
      : size(size),
        fourier(queue, size.nx, size.nz, size.planes, kernels),
        field(random_field(fourier.field_size())),
        field_array(queue.array(std::vector<T>(field.begin(), field.end()))),
        spectrum(queue.array(std::vector<T>(fourier.spectrum_size(), kUntouched))) {}
  void forward(std::size_t first, std::size_t count) { fourier.forward(field_array, spectrum, first, count); }
  // Into another field.
  std::vector<T> backward(std::size_t first, std::size_t count) {
    auto back = queue.array(std::vector<T>(fourier.field_size(), kUntouched));
    fourier.backward(spectrum, back, first, count);
    return queue.read(back);
  }
  // Largest difference of a plane's spectrum from sums in double, over sqrt(nx nz) epsilon: its numbers are
  // of the size of sqrt(nx nz).
  double error(std::size_t plane) {
    const std::vector<T> host = queue.read(spectrum);
    const auto [nx, nz, planes] = size;
    const auto expected = plain_transform(field.data() + plane * nx * nz, nx, nz);
    const std::size_t pitch = fourier.pitch();
    double largest = 0;
    for (std::size_t kz = 0; kz < nz; ++kz)
      for (std::size_t kx = 0; kx < pitch; ++kx) {
        const std::size_t at = (2 * plane * nz + kz) * pitch + kx;
        const Complex wanted = kx <= nx / 2 ? expected[kz * nx + kx] : 0;
        largest = std::max(largest, std::abs(Complex(host[at], host[at + nz * pitch]) - wanted));
      }
    return largest / std::sqrt(static_cast<double>(nx * nz)) / std::numeric_limits<T>::epsilon();
  }
  bool untouched(std::size_t plane) {
    const std::vector<T> host = queue.read(spectrum);
    const std::size_t each = fourier.spectrum_size() / size.planes;
    return std::all_of(host.begin() + static_cast<long>(plane * each),
                       host.begin() + static_cast<long>((plane + 1) * each),
                       [](T value) { return value == kUntouched; });
  }
  static constexpr T kUntouched = 123;
  Size size;
  Queue queue = test_device()->queue();
  Fourier<T> fourier;
  std::vector<double> field;
  Array<T> field_array, spectrum;
};

// What rounding may come to, in epsilons.
constexpr double kRounding = 8;

template <class T>
void expect_sums_and_back(const Size& size, FourierKernels kernels) {
  SCOPED_TRACE(testing::Message() << size.nx << " x " << size.nz << " x " << size.planes << ", " << sizeof(T)
                                  << " bytes, kernels " << static_cast<int>(kernels));
  OnDevice<T> device(size, kernels);
  device.forward(0, size.planes);
  for (std::size_t plane = 0; plane < size.planes; ++plane)
    EXPECT_LE(device.error(plane), kRounding) << "plane " << plane;
  const std::vector<T> back = device.backward(0, size.planes);
  double error = 0;
  for (std::size_t n = 0; n < back.size(); ++n)
    error = std::max(error, std::abs(static_cast<double>(back[n]) - device.field[n]));
  EXPECT_LE(error, kRounding * std::numeric_limits<T>::epsilon());
}

template <class T>
void expect_the_range_alone(const Size& size, FourierKernels kernels, std::size_t first, std::size_t count) {
  OnDevice<T> device(size, kernels);
  device.forward(first, count);
  for (std::size_t plane = 0; plane < size.planes; ++plane)
    if (plane >= first && plane < first + count)
      EXPECT_LE(device.error(plane), kRounding) << plane;
    else
      EXPECT_TRUE(device.untouched(plane)) << plane;
  const std::vector<T> back = device.backward(first, count);
  for (std::size_t n = 0; n < back.size(); ++n) {
    const std::size_t plane = n / (size.nx * size.nz);
    if (plane >= first && plane < first + count)
      ASSERT_NEAR(back[n], device.field[n], kRounding * std::numeric_limits<T>::epsilon()) << n;
    else
      ASSERT_EQ(back[n], device.kUntouched) << n;
  }
}

class FourierOf : public testing::TestWithParam<FourierKernels> {};

TEST_P(FourierOf, PlanesAreSumsAndComeBack) {
  for (const Size& size : {Size{2, 1, 3}, Size{4, 1, 5}, Size{8, 4, 3}, Size{4, 16, 2}, Size{16, 2, 7},
                           Size{32, 8, 2}, Size{64, 32, 5}, Size{128, 64, 2}, Size{128, 1, 21}})
    expect_sums_and_back<float>(size, GetParam());
}

TEST_P(FourierOf, PlanesInDoubleAreSumsAndComeBack) {
  if (!test_device()->info().has_double) GTEST_SKIP() << "no double precision";
  for (const Size& size : {Size{2, 1, 3}, Size{8, 4, 3}, Size{64, 32, 5}, Size{128, 64, 2}})
    expect_sums_and_back<double>(size, GetParam());
}

TEST_P(FourierOf, LargestPlanesAreSumsAndComeBack) {
  expect_sums_and_back<float>({512, 256, 1}, GetParam());
  expect_sums_and_back<float>({256, 512, 1}, GetParam());
}

TEST_P(FourierOf, OtherPlanesAreLeftAlone) {
  expect_the_range_alone<float>({16, 2, 7}, GetParam(), 1, 5);
  expect_the_range_alone<float>({128, 1, 21}, GetParam(), 3, 17);
  expect_the_range_alone<float>({64, 32, 5}, GetParam(), 2, 3);
  expect_the_range_alone<float>({64, 32, 3}, GetParam(), 3, 0);
}

INSTANTIATE_TEST_SUITE_P(Kernels, FourierOf,
                         testing::Values(FourierKernels::kItems, FourierKernels::kGroups));

TEST(Fourier, RefusesWhatItHasNoKernelsFor) {
  const Queue queue = test_device()->queue();
  for (const Size& size : {Size{1, 4, 1}, Size{0, 4, 1}, Size{12, 4, 1}, Size{8, 3, 1}, Size{8, 0, 1},
                           Size{1024, 4, 1}, Size{8, 1024, 1}})
    EXPECT_THROW(Fourier<float>(queue, size.nx, size.nz, size.planes), std::invalid_argument)
        << size.nx << " x " << size.nz;
}

TEST(Fourier, RefusesPlanesThatThereAreNot) {
  const Queue queue = test_device()->queue();
  Fourier<float> fourier(queue, 8, 4, 3);
  auto field = queue.array<float>(fourier.field_size()),
       spectrum = queue.array<float>(fourier.spectrum_size());
  auto small = queue.array<float>(fourier.field_size() - 1);
  EXPECT_THROW(fourier.forward(field, spectrum, 1, 3), std::invalid_argument);
  EXPECT_THROW(fourier.backward(spectrum, field, 4, 0), std::invalid_argument);
  EXPECT_THROW(fourier.forward(small, spectrum, 0, 3), std::invalid_argument);
  EXPECT_THROW(fourier.backward(small, field, 0, 3), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::service
