#include <algorithm>
#include <cmath>
#include <vector>

#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/modulus/strip_model.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kDeeper = 2;  // than the image: what is bonded there is not seen

class ProbedBlock : public ProbedTissue {
 public:
  ProbedBlock(const ProbeFace& face, StripCache& strips, double cell_m)
      : face_(face),
        strip_(strips.get({face.width_m, kDeeper * face.image_depth_m, 0, face.poisson_ratio, Plane::kStress},
                          face.width_m)) {
    const auto cells = [cell_m](double length_m) {
      return std::max<std::size_t>(4, static_cast<std::size_t>(std::lround(length_m / cell_m)));
    };
    cells_.columns = cells(face.width_m), cells_.rows = cells(face.image_depth_m);
    cells_.spacing_m = face.width_m / static_cast<double>(cells_.columns);
    cells_.row_m = face.image_depth_m / static_cast<double>(cells_.rows);
    cells_.first_x_m = cells_.spacing_m / 2;
    image_ = {cells_.columns,   cells_.rows,      cells_.first_x_m,
              cells_.row_m / 2, cells_.spacing_m, cells_.row_m};
  }

  // A tilt strains each line of a tall block by its own push.
  Response push(const VectorXd& log_modulus, double tilt, const Planes&) override {
    Field map(cells_.size());
    for (std::size_t c = 0; c < map.size(); ++c)
      map[c] = static_cast<float>(std::exp(log_modulus[static_cast<Index>(c)]));
    const std::vector<double> e = strip_->model.on_elements(map, image_, std::exp(log_modulus.mean()));
    const StripResponse response = strip_->model.solve(e);
    const TissueGrid& grid = strip_->model.grid();
    std::vector<double> axial(grid.elements()), lateral(grid.elements());
    for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
      for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
        const std::size_t element = grid.element(i, j);
        const auto u = [&](std::size_t a, std::size_t b) {
          return response.displacement[2 * grid.node(a, b)];
        };
        axial[element] = response.stress[element] / e[element];
        lateral[element] =
            (u(i + 1, j) + u(i + 1, j + 1) - u(i, j) - u(i, j + 1)) / (2 * (grid.x_m[i + 1] - grid.x_m[i]));
      }
    Response out;
    out.axial_strain = tilted(strip_->model.on_image(axial, image_), tilt);
    out.lateral_strain = tilted(strip_->model.on_image(lateral, image_), tilt);
    out.force_n = response.force_n_per_m * face_.elevation_m;
    return out;
  }

 private:
  VectorXd tilted(const Field& strain, double tilt) const {
    VectorXd out(static_cast<Index>(strain.size()));
    for (std::size_t c = 0; c < strain.size(); ++c)
      out[static_cast<Index>(c)] = strain[c] * (1 + tilt * (2 * cells_.x_m(c) / face_.width_m - 1));
    return out;
  }
  ProbeFace face_;
  std::shared_ptr<StripCache::Entry> strip_;
  ImageGrid image_;  // the cells' centres
};

}  // namespace

std::unique_ptr<ProbedTissue> make_probed_block(const ProbeFace& face, StripCache& strips, double cell_m) {
  return std::make_unique<ProbedBlock>(face, strips, cell_m);
}

}  // namespace teletact::service
