#include "service/tissue/solid/layered_factor.h"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>
#include <vector>

#include "service/device/cancellation.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

namespace {

using Eigen::Matrix3d;

// Of a layer of modulus 1: the stiffness between its upper side's nodes, from upper to lower, and between
// its lower side's, summed over the elements around a node, by the offset of the second node.
struct LayerStencil {
  std::array<std::array<Matrix3d, 9>, 3> blocks;  // [uu, ul, ll][(dx + 1) + 3 (dz + 1)]
};

LayerStencil layer_stencil(const SolidGrid& grid, std::size_t layer, double poisson_ratio) {
  const HexahedronMatrix k = layer_stiffness(grid, layer, poisson_ratio);
  LayerStencil out;
  for (auto& offsets : out.blocks) offsets.fill(Matrix3d::Zero());
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < 4; ++b) {
      const int dx = (b & 1) - (a & 1), dz = (b >> 1) - (a >> 1);
      const auto at = static_cast<std::size_t>((dx + 1) + 3 * (dz + 1));
      out.blocks[0][at] += k.block<3, 3>(3 * a, 3 * b);
      out.blocks[1][at] += k.block<3, 3>(3 * a, 3 * (b + 4));
      out.blocks[2][at] += k.block<3, 3>(3 * (a + 4), 3 * (b + 4));
    }
  return out;
}

// cos and sin of the wave number's step from a node to the next, exact where they are 0 or 1.
struct Wave {
  double cosine = 1, sine = 0;
};
Wave wave(std::size_t k, std::size_t n) {
  if (k == 0) return {};
  if (2 * k == n) return {-1, 0};
  if (4 * k == n) return {0, 1};
  const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(n);
  return {std::cos(angle), std::sin(angle)};
}

// T^* A T, A = sum over offsets of the blocks times exp(i (kx dx + kz dz)), T = diag(1, i, 1): real. At one
// kz, by kx.
class Symbol {
 public:
  Symbol() = default;
  Symbol(const std::array<Matrix3d, 9>& blocks, const Wave& z) {
    for (std::size_t dx = 0; dx < 3; ++dx) {
      const Matrix3d &behind = blocks[dx], &middle = blocks[dx + 3], &ahead = blocks[dx + 6];
      const Matrix3d real = middle + z.cosine * (behind + ahead), imaginary = z.sine * (ahead - behind);
      const double side = static_cast<double>(dx) - 1;
      for (int p = 0; p < 3; ++p)
        for (int q = 0; q < 3; ++q) {
          const bool turned = (p == 1) != (q == 1);
          const double sign = turned && q == 1 ? -1 : 1;
          const double even = sign * (turned ? imaginary : real)(p, q),
                       odd = sign * side * (turned ? real(p, q) : -imaginary(p, q));
          (side == 0 ? constant_ : of_cosine_)(p, q) += even;
          of_sine_(p, q) += odd;
        }
    }
  }
  Matrix3d at(const Wave& x) const { return constant_ + x.cosine * of_cosine_ + x.sine * of_sine_; }

 private:
  Matrix3d constant_ = Matrix3d::Zero(), of_cosine_ = Matrix3d::Zero(), of_sine_ = Matrix3d::Zero();
};

// Eliminates for every pair of wave numbers: `row`(kx, kz, j, S_j^-1, W_j-1), from the bottom up.
template <class Row>
void eliminate(const SolidGrid& grid, const LayeredTissue& tissue, double poisson_ratio, const Row& row) {
  const std::size_t layers = grid.layers();
  constexpr double kAlike = 1e-9;  // heights: what differs less does so by rounding
  std::vector<double> heights_m;
  std::vector<LayerStencil> stencils;
  std::vector<std::size_t> kind;  // of each layer
  for (std::size_t j = 0; j < layers; ++j) {
    const double height_m = grid.y_m[j + 1] - grid.y_m[j];
    const auto at = std::ranges::find_if(
        heights_m, [&](double known_m) { return std::abs(height_m - known_m) < kAlike * known_m; });
    const bool rollers = grid.slides && j + 1 == layers;
    if (at != heights_m.end() && !rollers) {
      kind.push_back(static_cast<std::size_t>(at - heights_m.begin()));
      continue;
    }
    kind.push_back(stencils.size());
    heights_m.push_back(height_m);
    stencils.push_back(layer_stencil(grid, j, poisson_ratio));
  }
  std::vector<Wave> along_x;
  for (std::size_t kx = 0; kx <= grid.nx / 2; ++kx) along_x.push_back(wave(kx, grid.nx));
  std::vector<std::array<Symbol, 3>> symbols(stencils.size());
  for (std::size_t kz = 0; kz <= grid.nz / 2; ++kz) {
    check_cancelled();
    const Wave z = wave(kz, grid.nz);
    for (std::size_t s = 0; s < stencils.size(); ++s)
      for (std::size_t b = 0; b < 3; ++b) symbols[s][b] = Symbol(stencils[s].blocks[b], z);
    for (std::size_t kx = 0; kx <= grid.nx / 2; ++kx) {
      const Wave& x = along_x[kx];
      Matrix3d below = Matrix3d::Zero();  // U_j S_(j+1)^-1 U_j^T
      for (std::size_t j = layers; j-- > 0;) {
        Matrix3d s = tissue.youngs_modulus_pa[j] * symbols[kind[j]][0].at(x) - below;
        if (j > 0) s += tissue.youngs_modulus_pa[j - 1] * symbols[kind[j - 1]][2].at(x);
        const Matrix3d inverse = s.inverse();
        Matrix3d coupling = Matrix3d::Zero();
        if (j > 0) {
          const Matrix3d u = tissue.youngs_modulus_pa[j - 1] * symbols[kind[j - 1]][1].at(x);
          coupling = inverse * u.transpose();
          below = u * coupling;
        }
        row(kx, kz, j, inverse, coupling);
      }
    }
  }
}

// The upper triangle of a symmetric block.
std::array<double, 6> upper(const Matrix3d& m) {
  return {m(0, 0), (m(0, 1) + m(1, 0)) / 2, (m(0, 2) + m(2, 0)) / 2,
          m(1, 1), (m(1, 2) + m(2, 1)) / 2, m(2, 2)};
}

}  // namespace

LayeredFactor factor(const SolidGrid& grid, const LayeredTissue& tissue, double poisson_ratio,
                     std::size_t pitch) {
  const std::size_t layers = grid.layers(), plane = (grid.nz / 2 + 1) * pitch;
  LayeredFactor out;
  out.pitch = pitch;
  grow(out.inverse, 6 * layers * plane, 0.0);
  grow(out.coupling, 9 * (layers - 1) * plane, 0.0);
  eliminate(grid, tissue, poisson_ratio,
            [&](std::size_t kx, std::size_t kz, std::size_t j, const Matrix3d& inverse, const Matrix3d& w) {
              const std::size_t at = kz * pitch + kx;
              const std::array<double, 6> entries = upper(inverse);
              for (std::size_t e = 0; e < 6; ++e) out.inverse[(6 * j + e) * plane + at] = entries[e];
              if (j == 0) return;
              for (std::size_t e = 0; e < 9; ++e)
                out.coupling[(9 * (j - 1) + e) * plane + at] =
                    w(static_cast<Eigen::Index>(e / 3), static_cast<Eigen::Index>(e % 3));
            });
  return out;
}

std::vector<double> row_symbol(const SolidGrid& grid, const LayeredTissue& tissue, double poisson_ratio,
                               std::size_t pitch, std::size_t row) {
  const std::size_t plane = (grid.nz / 2 + 1) * pitch;
  std::vector<double> out(6 * plane, 0.0);
  std::vector<Matrix3d> inverses(row + 1), couplings(row + 1);  // of one pair of wave numbers
  eliminate(grid, tissue, poisson_ratio,
            [&](std::size_t kx, std::size_t kz, std::size_t j, const Matrix3d& inverse, const Matrix3d& w) {
              if (j > row) return;
              inverses[j] = inverse, couplings[j] = w;
              if (j > 0) return;
              Matrix3d compliance = inverse;
              for (std::size_t i = 1; i <= row; ++i)
                compliance = inverses[i] + couplings[i] * compliance * couplings[i].transpose();
              const std::array<double, 6> entries = upper(compliance);
              for (std::size_t e = 0; e < 6; ++e) out[e * plane + kz * pitch + kx] = entries[e];
            });
  return out;
}

namespace {

constexpr std::size_t kWidth = 8;  // a row of a spectrum is a multiple of it
constexpr std::size_t kWarp = 32;
constexpr std::size_t kOfRow = 6;  // products of an unknown that is eliminated: of the row below, of its own

}  // namespace

template <class T>
LayeredPreconditioner<T>::LayeredPreconditioner(const Queue& queue, const SolidGrid& grid,
                                                const LayeredTissue& tissue, double poisson_ratio)
    : queue_(queue),
      layers_(static_cast<int>(grid.layers())),
      nz_(static_cast<int>(grid.nz)),
      fourier_(queue, grid.nx, grid.nz, 3 * grid.layers()),
      surface_fourier_(queue, grid.nx, grid.nz, 3) {
  const LayeredFactor f = factor(grid, tissue, poisson_ratio, fourier_.pitch());
  compliance_.emplace(grid.nx, grid.nz, f.inverse, f.pitch, grid.nx, grid.nz);
  inverse_ = queue.array(std::vector<T>(f.inverse.begin(), f.inverse.end()));
  coupling_ = queue.array(std::vector<T>(f.coupling.begin(), f.coupling.end()));
  spectrum_ = queue.array<T>(fourier_.spectrum_size());
  surface_ = queue.array<T>(surface_fourier_.spectrum_size());
  queue_.fill_zero(surface_);
  const std::size_t width = queue.info().gpu ? 1 : kWidth;
  const Defines defines{{"WIDTH", std::to_string(width)}};
  up_ = queue.kernel("layers", "layers_up", precision_of<T>, defines);
  down_ = queue.kernel("layers", "layers_down", precision_of<T>, defines);
  range_ = {{fourier_.pitch() / width, grid.nz}, {queue.info().gpu ? kWarp : 1, 1}, kOfRow * grid.layers()};
}

template <class T>
void LayeredPreconditioner<T>::eliminate(const Components& components) {
  up_(range_, inverse_, coupling_, spectrum_, surface_, layers_, nz_, static_cast<int>(fourier_.pitch()),
      static_cast<int>(components.first), static_cast<int>(components.count));
}

template <class T>
void LayeredPreconditioner<T>::up(const Array<T>& r, const Components& components, Array<T>& surface) {
  fourier_.forward(r, spectrum_, 0, static_cast<std::size_t>(3 * layers_));
  eliminate(components);
  surface_fourier_.backward(surface_, surface, components.first, components.count);
}

template <class T>
void LayeredPreconditioner<T>::substitute(const Components& components) {
  down_(range_, inverse_, coupling_, spectrum_, surface_, layers_, nz_, static_cast<int>(fourier_.pitch()),
        static_cast<int>(components.first), static_cast<int>(components.count));
}

template <class T>
void LayeredPreconditioner<T>::down(const Array<T>& surface, const Components& components, Array<T>& z) {
  surface_fourier_.forward(surface, surface_, components.first, components.count);
  substitute(components);
  fourier_.backward(spectrum_, z, 0, static_cast<std::size_t>(3 * layers_));
}

template <class T>
void LayeredPreconditioner<T>::solve_surface(const Array<T>& surface, const Components& components,
                                             Array<T>& z) {
  queue_.fill_zero(spectrum_);
  down(surface, components, z);
}

template class LayeredPreconditioner<float>;
template class LayeredPreconditioner<double>;

}  // namespace teletact::service
