#include "service/tissue/solid/element_shares.h"

#include <algorithm>
#include <numeric>

#include "service/device/cancellation.h"
#include "service/tissue/solid/hexahedron.h"

namespace teletact::service {

template <class T>
std::vector<double> work_of_elements(const SolidTissue& tissue, const std::vector<T>& u,
                                     const std::vector<T>& z, bool mirrored) {
  const SolidGrid& grid = tissue.grid;
  const std::size_t nx = grid.nx, nz = grid.nz, columns = grid.columns();
  using Moved = Eigen::Matrix<double, 24, Eigen::Dynamic>;  // of the elements of a line along x
  const std::size_t max_x = mirrored ? (nx + 1) / 2 : nx, max_z = mirrored ? (nz + 1) / 2 : nz;
  const auto line = static_cast<Eigen::Index>(max_x);
  Moved moved_u = Moved::Zero(24, line), moved_z = moved_u;
  const auto gather = [&](const std::vector<T>& field, std::size_t j, std::size_t k, Moved& moved) {
    for (std::size_t corner = 0; corner < 8; ++corner) {
      const std::size_t row = j + corner / 4, at = nx * ((k + corner / 2 % 2) % nz);
      for (std::size_t c = 0; c < 3; ++c) {
        auto of_corner = moved.row(static_cast<Eigen::Index>(3 * corner + c));
        if (row == grid.layers()) {  // held
          of_corner.setZero();
          continue;
        }
        const T* plane = field.data() + (3 * row + c) * columns + at;
        for (std::size_t x = 0; x < max_x; ++x)
          of_corner[static_cast<Eigen::Index>(x)] = static_cast<double>(plane[(x + corner % 2) % nx]);
      }
    }
  };
  std::vector<double> work(grid.elements());
  for (std::size_t j = 0; j < grid.layers(); ++j) {
    const HexahedronMatrix stiffness = hexahedron_stiffness(grid.spacing_x_m, grid.y_m[j + 1] - grid.y_m[j],
                                                            grid.spacing_z_m, tissue.poisson_ratio);
    for (std::size_t k = 0; k < max_z; ++k) {
      check_cancelled();
      gather(u, j, k, moved_u);
      gather(z, j, k, moved_z);
      const std::size_t first = (j * nz + k) * nx;
      const Eigen::RowVectorXd sum = moved_z.cwiseProduct(stiffness * moved_u).colwise().sum();
      for (std::size_t x = 0; x < max_x; ++x)
        work[first + x] = tissue.youngs_modulus_pa[first + x] * sum[static_cast<Eigen::Index>(x)];
      if (!mirrored) continue;
      for (std::size_t x = 0; x < max_x; ++x) work[first + nx - 1 - x] = work[first + x];
      std::copy_n(work.begin() + static_cast<long>(first), nx,
                  work.begin() + static_cast<long>((j * nz + nz - 1 - k) * nx));
    }
  }
  return work;
}

template std::vector<double> work_of_elements(const SolidTissue&, const std::vector<float>&,
                                              const std::vector<float>&, bool);
template std::vector<double> work_of_elements(const SolidTissue&, const std::vector<double>&,
                                              const std::vector<double>&, bool);

ElementMeans::ElementMeans(const Queue& queue, const SolidGrid& grid, std::size_t at_once)
    : queue_(queue),
      layers_(grid.layers()),
      elements_(queue, grid.nx, grid.nz, grid.layers()),
      surface_(queue, grid.nx, grid.nz, at_once),
      field_(queue.array<float>(elements_.field_size())),
      spectrum_(queue.array<float>(elements_.spectrum_size())),
      plane_(queue.array<float>(surface_.field_size())),
      sum_(queue.array<float>(surface_.spectrum_size())) {}

ElementMeans::Map ElementMeans::transformed(const std::vector<float>& of_elements) {
  queue_.write(field_, of_elements.data(), of_elements.size());
  elements_.forward(field_, spectrum_, 0, layers_);
  return queue_.read(spectrum_);
}

template <class T>
ElementMeans::Map ElementMeans::shares(const SolidTissue& layers, const std::vector<T>& u,
                                       const std::vector<T>& z) {
  const std::vector<double> work = work_of_elements(layers, u, z, true);
  const double sum = std::accumulate(work.begin(), work.end(), 0.0);
  std::vector<float> shares;
  shares.reserve(work.size());
  for (const double w : work) shares.push_back(static_cast<float>(w / sum));
  return transformed(shares);
}

template ElementMeans::Map ElementMeans::shares(const SolidTissue&, const std::vector<float>&,
                                                const std::vector<float>&);
template ElementMeans::Map ElementMeans::shares(const SolidTissue&, const std::vector<double>&,
                                                const std::vector<double>&);

Eigen::VectorXd ElementMeans::means(const Map& shares, const Map& map) {
  return means({{&shares, &map}}).front();
}

std::vector<Eigen::VectorXd> ElementMeans::means(const std::vector<std::pair<const Map*, const Map*>>& all) {
  const std::size_t plane = elements_.spectrum_size() / layers_, part = plane / 2;  // real, imaginary
  std::vector<float> sums(all.size() * plane);
  using Of = Eigen::Map<const Eigen::ArrayXf>;
  const auto length = static_cast<Eigen::Index>(part);
  for (std::size_t n = 0; n < all.size(); ++n) {
    Eigen::Map<Eigen::ArrayXf> sum(sums.data() + n * plane, length),
        sum_imaginary(sums.data() + n * plane + part, length);
    for (std::size_t j = 0; j < layers_; ++j) {
      const float *map = all[n].second->data() + j * plane, *share = all[n].first->data() + j * plane;
      const Of real(map, length), imaginary(map + part, length), share_real(share, length),
          share_imaginary(share + part, length);
      sum += share_real * real + share_imaginary * imaginary;
      sum_imaginary += share_real * imaginary - share_imaginary * real;
    }
  }
  queue_.write(sum_, sums.data(), sums.size());
  surface_.backward(sum_, plane_, 0, all.size());
  const std::vector<float> means = queue_.read(plane_);
  const std::size_t nodes = elements_.field_size() / layers_;
  std::vector<Eigen::VectorXd> out;
  for (std::size_t n = 0; n < all.size(); ++n)
    out.push_back(
        Eigen::Map<const Eigen::VectorXf>(means.data() + n * nodes, static_cast<Eigen::Index>(nodes))
            .cast<double>());
  return out;
}

}  // namespace teletact::service
