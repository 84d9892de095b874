#include "service/solid/element_shares.h"

#include <algorithm>
#include <cmath>

#include "service/device/look.h"
#include "service/solid/hexahedron.h"

namespace teletact::service {

template <class T>
std::vector<double> work_of_elements(const SolidTissue& tissue, const std::vector<T>& u,
                                     const std::vector<T>& z, bool mirrored) {
  const SolidGrid& grid = tissue.grid;
  const std::size_t nx = grid.nx, nz = grid.nz, columns = grid.columns();
  // Of the elements of a line along x, a freedom a row.
  using Moved = Eigen::Matrix<double, 24, Eigen::Dynamic, Eigen::RowMajor>;
  const std::size_t most_x = mirrored ? (nx + 1) / 2 : nx, most_z = mirrored ? (nz + 1) / 2 : nz;
  const auto line = static_cast<Eigen::Index>(most_x);
  Moved moved_u = Moved::Zero(24, line), moved_z = moved_u;
  const auto gather = [&](const std::vector<T>& field, std::size_t j, std::size_t k, Moved& moved) {
    for (std::size_t corner = 0; corner < 8; ++corner) {
      const std::size_t row = j + corner / 4, at = nx * ((k + corner / 2 % 2) % nz), shift = corner % 2;
      for (std::size_t c = 0; c < 3; ++c) {
        double* of_corner = moved.row(static_cast<Eigen::Index>(3 * corner + c)).data();
        if (row == grid.layers()) {  // held
          std::fill_n(of_corner, most_x, 0.0);
          continue;
        }
        const T* plane = field.data() + (3 * row + c) * columns + at;
        std::copy_n(plane + shift, std::min(most_x, nx - shift), of_corner);
        if (most_x + shift > nx) of_corner[most_x - 1] = plane[0];  // the period's copy
      }
    }
  };
  std::vector<double> work(grid.elements());
  HexahedronMatrix stiffness;
  double thickness_m = 0;  // that it is of
  for (std::size_t j = 0; j < grid.layers(); ++j) {
    const double own_m = grid.y_m[j + 1] - grid.y_m[j];
    if (std::abs(own_m - thickness_m) > 1e-12 * own_m) {
      thickness_m = own_m;
      stiffness = hexahedron_stiffness(grid.spacing_x_m, own_m, grid.spacing_z_m, tissue.poisson_ratio);
    }
    for (std::size_t k = 0; k < most_z; ++k) {
      look();
      gather(u, j, k, moved_u);
      gather(z, j, k, moved_z);
      const std::size_t first = (j * nz + k) * nx;
      const Eigen::RowVectorXd sum = moved_z.cwiseProduct(stiffness * moved_u).colwise().sum();
      for (std::size_t x = 0; x < most_x; ++x)
        work[first + x] = tissue.youngs_modulus_pa[first + x] * sum[static_cast<Eigen::Index>(x)];
      if (!mirrored) continue;
      for (std::size_t x = 0; x < most_x; ++x) work[first + nx - 1 - x] = work[first + x];
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

namespace {

// Sum over the layers of conj(share) map: planes of `part` real numbers and as many imaginary ones. By lanes,
// so that sums stay in registers.
constexpr std::size_t kLane = 8;  // divides a plane's pitch
void sum_products(const float* share, const float* map, std::size_t layers, std::size_t part, float* sum) {
  using Lane = Eigen::Array<float, kLane, 1>;
  using Of = Eigen::Map<const Lane>;
  for (std::size_t n = 0; n < part; n += kLane) {
    Lane real = Lane::Zero(), imaginary = Lane::Zero();
    for (std::size_t j = 0; j < layers; ++j) {
      const std::size_t at = 2 * part * j + n;
      const Of a(share + at), b(share + at + part), c(map + at), d(map + at + part);
      real += a * c + b * d;
      imaginary += a * d - b * c;
    }
    Eigen::Map<Lane>(sum + n) = real;
    Eigen::Map<Lane>(sum + part + n) = imaginary;
  }
}

}  // namespace

ElementMeans::ElementMeans(const Queue& queue, const SolidGrid& grid, std::size_t most_maps,
                           std::size_t most_shares)
    : queue_(queue),
      layers_(grid.layers()),
      elements_(queue, grid.nx, grid.nz, most_maps * grid.layers()),
      surface_(queue, grid.nx, grid.nz, most_maps * most_shares),
      field_(queue.array<float>(elements_.field_size())),
      spectrum_(queue.array<float>(elements_.spectrum_size())),
      plane_(queue.array<float>(surface_.field_size())),
      sum_(queue.array<float>(surface_.spectrum_size())) {}

void ElementMeans::transform(const std::vector<float>& of_elements, Maps& to) {
  const std::size_t planes = of_elements.size() / (field_.size() / elements_.planes());
  queue_.write(field_, of_elements.data(), of_elements.size());
  elements_.forward(field_, spectrum_, 0, planes);
  to.resize(planes * (spectrum_.size() / elements_.planes()));
  queue_.read(spectrum_, to.data(), to.size());
}

std::vector<Eigen::VectorXd> ElementMeans::means(const std::vector<Maps>& shares, const Maps& maps) {
  const std::size_t plane = spectrum_.size() / elements_.planes(), part = plane / 2;  // real, imaginary
  const std::size_t map = layers_ * plane, count = shares.size() * (maps.size() / map);
  sums_.resize(count * plane);
  for (std::size_t n = 0; n < count; ++n)
    sum_products(shares[n % shares.size()].data(), maps.data() + n / shares.size() * map, layers_, part,
                 sums_.data() + n * plane);
  queue_.write(sum_, sums_.data(), sums_.size());
  surface_.backward(sum_, plane_, 0, count);
  const std::size_t nodes = field_.size() / elements_.planes();
  means_.resize(count * nodes);
  queue_.read(plane_, means_.data(), means_.size());
  std::vector<Eigen::VectorXd> out;
  for (std::size_t n = 0; n < count; ++n)
    out.push_back(
        Eigen::Map<const Eigen::VectorXf>(means_.data() + n * nodes, static_cast<Eigen::Index>(nodes))
            .cast<double>());
  return out;
}

}  // namespace teletact::service
