// Test problems for the solver that know no physics: random symmetric positive definite 9-point stencils of
// 2x2 blocks, and the same as a dense matrix. Written with plain loops.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <random>
#include <vector>

#include "service/device/device.h"

namespace teletact::service {

inline std::shared_ptr<Device> test_device() {
  static const std::shared_ptr<Device> device = Device::open();
  return device;
}

// The same, taken for a GPU: work-groups, one number an item.
inline std::shared_ptr<Device> test_gpu() {
  DeviceOptions options;
  options.as_gpu = true;
  static const std::shared_ptr<Device> device = Device::open(options);
  return device;
}

struct BlockStencil {
  std::size_t nx = 0, ny = 0;
  std::vector<double> blocks;      // [9][ny][nx][4]
  std::vector<std::uint8_t> free;  // [node][2]
  std::size_t nodes() const { return nx * ny; }
  std::size_t unknowns() const { return 2 * nx * ny; }

  Eigen::MatrixXd dense() const {
    Eigen::MatrixXd a =
        Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(unknowns()), static_cast<Eigen::Index>(unknowns()));
    for (std::size_t n = 0; n < nodes(); ++n)
      for (std::size_t k = 0; k < 9; ++k) {
        const long i = static_cast<long>(n % nx) + static_cast<long>(k % 3) - 1;
        const long j = static_cast<long>(n / nx) + static_cast<long>(k / 3) - 1;
        if (i < 0 || j < 0 || i >= static_cast<long>(nx) || j >= static_cast<long>(ny)) continue;
        for (long c = 0; c < 4; ++c)
          a(static_cast<long>(2 * n) + c / 2, 2 * (i + static_cast<long>(nx) * j) + c % 2) =
              blocks[4 * (k * nodes() + n) + static_cast<std::size_t>(c)];
      }
    return a;
  }
  template <class T>
  std::vector<T> as() const {
    return {blocks.begin(), blocks.end()};
  }
};

// Sum over cells of c B^T B, B eight random rows close to differences between corners (so that it is a
// discretised differential operator, as multigrid expects), c random over `contrast`; plus a little identity.
// Some unknowns are constrained: the lowest row and a few by chance.
inline BlockStencil random_stencil(std::size_t nx, std::size_t ny, double contrast, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  BlockStencil s{nx, ny, std::vector<double>(36 * nx * ny), std::vector<std::uint8_t>(2 * nx * ny, 1)};
  for (std::size_t i = 0; i < nx; ++i)
    s.free[2 * (i + nx * (ny - 1))] = s.free[2 * (i + nx * (ny - 1)) + 1] = 0;
  for (int k = 0; k < 5; ++k) s.free[random() % s.free.size()] = 0;
  const auto add = [&](std::size_t from, std::size_t to, long row, long column, double value) {
    const long di = static_cast<long>(to % nx) - static_cast<long>(from % nx);
    const long dj = static_cast<long>(to / nx) - static_cast<long>(from / nx);
    const auto k = static_cast<std::size_t>(3 * (dj + 1) + di + 1);
    s.blocks[4 * (k * s.nodes() + from) + static_cast<std::size_t>(2 * row + column)] += value;
  };
  for (std::size_t j = 0; j + 1 < ny; ++j)
    for (std::size_t i = 0; i + 1 < nx; ++i) {
      const std::size_t corner[4] = {i + nx * j, i + 1 + nx * j, i + nx * (j + 1), i + 1 + nx * (j + 1)};
      Eigen::MatrixXd b = Eigen::MatrixXd::Zero(8, 8);
      const int pairs[4][2] = {{0, 1}, {2, 3}, {0, 2}, {1, 3}};
      for (int p = 0; p < 4; ++p)
        for (int c = 0; c < 2; ++c) {
          b(2 * p + c, 2 * pairs[p][0] + c) = -1;
          b(2 * p + c, 2 * pairs[p][1] + c) = 1;
          b(2 * p + c, 2 * pairs[p][0] + 1 - c) = 0.3;  // couples the two unknowns
          b(2 * p + c, 2 * pairs[p][1] + 1 - c) = -0.3;
        }
      const Eigen::MatrixXd a = std::pow(contrast, uniform(random) / 2) *
                                (b.transpose() * b + 1e-3 * Eigen::MatrixXd::Identity(8, 8));
      for (int m = 0; m < 8; ++m)
        for (int n = 0; n < 8; ++n) add(corner[m / 2], corner[n / 2], m % 2, n % 2, a(m, n));
    }
  for (std::size_t n = 0; n < s.nodes(); ++n)
    for (std::size_t k = 0; k < 9; ++k) {
      const long to = static_cast<long>(n) + static_cast<long>(k % 3) - 1 +
                      static_cast<long>(nx) * (static_cast<long>(k / 3) - 1);
      if (to < 0 || to >= static_cast<long>(s.nodes())) continue;
      for (std::size_t c = 0; c < 4; ++c) {
        double& value = s.blocks[4 * (k * s.nodes() + n) + c];
        const bool row = s.free[2 * n + c / 2], column = s.free[2 * static_cast<std::size_t>(to) + c % 2];
        if (!row || !column) value = k == 4 && (c == 0 || c == 3) ? 1 : 0;
      }
    }
  return s;
}

// `count` vectors of values in [-1, 1], zero on constrained unknowns.
inline Eigen::MatrixXd random_vectors(const BlockStencil& s, std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Eigen::MatrixXd v(static_cast<Eigen::Index>(s.unknowns()), static_cast<Eigen::Index>(count));
  for (Eigen::Index q = 0; q < v.cols(); ++q)
    for (Eigen::Index n = 0; n < v.rows(); ++n)
      v(n, q) = s.free[static_cast<std::size_t>(n)] ? uniform(random) : 0;
  return v;
}

// Columns to a device vector and back.
template <class T>
Array<T> upload(const Queue& queue, const Eigen::MatrixXd& v) {
  return queue.array(std::vector<T>(v.data(), v.data() + v.size()));
}

template <class T>
Eigen::MatrixXd download(const Queue& queue, const Array<T>& a, std::size_t count) {
  const std::vector<T> host = queue.read(a);
  Eigen::MatrixXd v(static_cast<Eigen::Index>(host.size() / count), static_cast<Eigen::Index>(count));
  for (Eigen::Index n = 0; n < v.size(); ++n) v.data()[n] = host[static_cast<std::size_t>(n)];
  return v;
}

}  // namespace teletact::service
