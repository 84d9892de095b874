#include <fmt/format.h>
#include <Eigen/Cholesky>

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "service/base/memory.h"
#include "service/device/cancellation.h"
#include "service/imaging/modulus/probed_tissue.h"
#include "service/tissue/solid/solid_solver.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Nodes under the probe across the plane, odd: one lies in it; fewer where the period would be too short.
constexpr std::size_t kMaxAcross = 7, kCoarseAcross = 5, kMinAcross = 3;
// Nodes h apart that are pushed alike act as a face that ends a tenth of h beyond the last: beside each other
// strains at 4 mm and deeper, and the force, are then within 1 % of a mesh five times as fine (of coarse
// cells a quarter fits strain best: 4 and 3 %).
constexpr double kBeyond = 0.2, kCoarseBeyond = 0.5;  // at both ends together
constexpr double kMinGap = 1.6;   // to the period's next probe, in depths of tissue, as far as there is room
constexpr double kMinPeriod = 8;  // the same, of tissue whose period is not felt
constexpr std::size_t kMaxColumns = 256, kMaxRows = 64, kMinPeriodAcross = 32, kMaxWide = 512;
constexpr std::size_t kMaxElements = 2'000'000;
constexpr double kCoarsen = 1.3, kCoarsestM = 4e-3;  // of rows below the image
constexpr double kMirroredM = 0.020;
constexpr double kBelowM = 3e-3;      // over which what a row differs by from its mean ends below the image
constexpr double kApartElements = 2;  // across the image: slices nearer than that are not told apart
constexpr double kAir = 0.01;         // of the tissue's modulus: beyond its end
// Accuracy of the solution, in energy. Where tissue ends, the bound is some ten times the error, and rounding
// may exceed it.
constexpr double kAccuracy = 2e-3, kAccuracyOfSides = 2e-2, kMinAccuracy = 5e-2;
// Iterations at least after a push that differed little, whose answer may be accurate enough at once: one
// finds nine tenths of what changed, where tissue ends a third.
constexpr std::size_t kAgain = 1, kAgainOfSides = 2;

void require_above_zero(double value, const char* field) {
  if (!(value > 0 && std::isfinite(value)))
    throw std::invalid_argument(fmt::format("{}: {} m is not positive and finite", field, value));
}

// `fine` rows of the image, and growing ones below it.
std::vector<double> rows_of_nodes(const ProbeFace& face, double image_m, std::size_t fine) {
  std::vector<double> y;
  const double row_m = image_m / static_cast<double>(fine), left_m = face.depth_m - image_m;
  for (std::size_t j = 0; j <= fine; ++j) y.push_back(row_m * static_cast<double>(j));
  if (left_m >= row_m / 2) {
    std::vector<double> steps;
    double reached_m = 0;
    for (double step_m = row_m; reached_m < left_m; reached_m += step_m)
      steps.push_back(step_m = std::min(step_m * kCoarsen, std::max(kCoarsestM, left_m / 16)));
    for (const double step_m : steps) y.push_back(y.back() + step_m * left_m / reached_m);
  }
  if (face.slides) y.push_back(y.back() + row_m);  // rollers
  return y;
}

double gap_m(const ProbeFace& face) {
  return kMinGap * face.depth_m;
}

// Nodes pressed along the image. Tissue that ends takes more steps than tissue that goes on: for it cells are
// a little wider where half of the nodes are enough then.
std::size_t nodes_along(const ProbeFace& face, double cell_m) {
  require_above_zero(face.width_m, "window_width_m");
  constexpr double kWidestM = 1.5e-3;
  const double of_half_m = (face.width_m + gap_m(face)) / static_cast<double>(kMaxColumns / 2),
               along_m = face.goes_on() || of_half_m > kWidestM ? cell_m : std::max(cell_m, of_half_m);
  return std::clamp<std::size_t>(static_cast<std::size_t>(face.width_m / along_m + 0.49), 8, kMaxColumns / 2);
}

double beyond(double cell_m) {
  return cell_m > kFineCellM ? kCoarseBeyond : kBeyond;
}
double spacing(double length_m, std::size_t nodes, double cell_m) {
  return length_m / (static_cast<double>(nodes - 1) + beyond(cell_m));
}

}  // namespace

CellGrid cells_under(const ProbeFace& face, double cell_m) {
  require_above_zero(face.image_depth_m, "image_depth_m");
  require_above_zero(face.depth_m, "depth_m");
  CellGrid cells;
  const double image_m = std::min(face.image_depth_m, face.depth_m);
  cells.columns = nodes_along(face, cell_m) - 1;
  cells.spacing_m = spacing(face.width_m, nodes_along(face, cell_m), cell_m);
  cells.first_x_m = (beyond(cell_m) / 2 + 0.5) * cells.spacing_m;
  cells.rows = std::clamp<std::size_t>(static_cast<std::size_t>(std::lround(image_m / cell_m)), 4, kMaxRows);
  cells.row_m = image_m / static_cast<double>(cells.rows);
  return cells;
}

namespace {

// Nodes of the face across the plane.
std::size_t nodes_across(const ProbeFace& face, double cell_m) {
  std::size_t nodes = cell_m > kFineCellM ? kCoarseAcross : kMaxAcross;
  const auto fits = [&](std::size_t columns) {
    return static_cast<double>(nodes) + gap_m(face) / spacing(face.elevation_m, nodes, cell_m) <=
           static_cast<double>(columns);
  };
  if (!face.goes_on() && !fits(kMaxColumns / 4)) nodes -= 2;
  while (nodes > kMinAcross && !fits(kMaxColumns)) nodes -= 2;
  return nodes;
}

std::size_t period(std::size_t nodes, double gap_m, double spacing_m) {
  const double wanted =
      std::min(static_cast<double>(nodes) + gap_m / spacing_m, static_cast<double>(kMaxColumns));
  return std::bit_ceil(static_cast<std::size_t>(wanted));
}

SolidTissue tissue_under(const ProbeFace& face, const CellGrid& cells, std::size_t across, double cell_m) {
  require_above_zero(face.elevation_m, "probe_elevation_m");
  SolidTissue tissue;
  tissue.grid.spacing_x_m = cells.spacing_m;
  tissue.grid.spacing_z_m = spacing(face.elevation_m, across, cell_m);
  tissue.grid.nx = period(cells.columns + 1, gap_m(face), tissue.grid.spacing_x_m);
  tissue.grid.nz = std::max(kMinPeriodAcross, period(across, gap_m(face), tissue.grid.spacing_z_m));
  tissue.grid.y_m = rows_of_nodes(face, cells.row_m * static_cast<double>(cells.rows), cells.rows);
  while (tissue.grid.elements() > kMaxElements && tissue.grid.nz > kMinPeriodAcross) tissue.grid.nz /= 2;
  tissue.grid.slides = face.slides;
  tissue.poisson_ratio = face.poisson_ratio;
  tissue.youngs_modulus_pa.assign(tissue.grid.elements(), 1.0);
  return tissue;
}

// Share of each element that lies within the tissue, along a period that begins at the face's first node,
// `wide` elements under the face, of which at most so much of the gap to the next face is left.
std::vector<double> within(const ProbeFace& face, std::size_t period, std::size_t wide, double spacing_m,
                           double beyond) {
  constexpr double kMaxOfGap = 0.875;
  const double gap = static_cast<double>(period - wide) - beyond,
               beside = std::min(face.beside_m / spacing_m, kMaxOfGap * gap / 2);
  std::vector<double> share(period, 1.0);
  if (face.goes_on()) return share;
  for (std::size_t n = wide; n < period; ++n) {
    const auto nearest = static_cast<double>(std::min(n - wide, period - 1 - n));
    share[n] = std::clamp(beside - (nearest - beyond / 2), 0.0, 1.0);
  }
  return share;
}

// Nodes (i, k) of the surface, the face's corner at i = 0, its middle at k = 0.
SurfacePatch patch_under(const SolidGrid& grid, std::size_t columns, std::size_t across) {
  SurfacePatch patch;
  for (std::size_t k = 0; k < across; ++k)
    for (std::size_t i = 0; i <= columns; ++i)
      patch.unknowns.push_back(i + grid.nx * ((k + grid.nz - across / 2) % grid.nz + grid.nz));
  patch.skin_m_n = VectorXd::Zero(static_cast<Index>(patch.unknowns.size()));
  return patch;
}

// Force on a face that is pushed by 1 m into layers of this compliance.
double force_of(const SurfaceCompliance& layered, const SurfacePatch& patch) {
  const Eigen::MatrixXd among = layered.among(patch.unknowns);
  return among.llt().solve(VectorXd::Ones(among.rows())).sum();
}

class ProbedSolid : public ProbedTissue {
 public:
  ProbedSolid(const Queue& queue, const ProbeFace& face, double cell_m, std::shared_ptr<ProbedTissue> last)
      : ProbedSolid(queue, face, cells_under(face, cell_m), nodes_across(face, cell_m), cell_m,
                    std::move(last)) {}
  ProbedSolid(const Queue& queue, const ProbeFace& face, const CellGrid& cells, std::size_t across,
              double cell_m, std::shared_ptr<ProbedTissue> last)
      : face_(face),
        nodes_across_(across),
        tissue_(tissue_under(face, cells, across, cell_m)),
        held_(queue.account().charge(Place::kHost, "tissues", sizeof(double) * tissue_.grid.elements())),
        along_(within(face, tissue_.grid.nx, cells.columns, cells.spacing_m, beyond(cell_m))),
        across_(within(face, tissue_.grid.nz, across - 1, tissue_.grid.spacing_z_m, beyond(cell_m))),
        patch_(patch_under(tissue_.grid, cells.columns, across)),
        queue_(queue),
        solver_(solver_of(std::move(last))) {
    cells_ = cells;
  }

  Response push(const VectorXd& log_modulus, double tilt, const Planes& planes) override {
    solver_->forget_last();
    return pushed(log_modulus, tilt, planes, 0);
  }

  Response push_again(const VectorXd& log_modulus, double tilt, const Planes& planes) override {
    return pushed(log_modulus, tilt, planes, face_.goes_on() ? kAgain : kAgainOfSides);
  }

  double nearest_plane_m() const override { return kApartElements * tissue_.grid.spacing_z_m; }

  double force_share() override {
    if (!face_.goes_on()) return 1;
    if (!force_share_) {
      const auto [grid, layers] = twice_as_coarse();
      const SurfacePatch patch = patch_under(grid, cells_.columns / 2, nodes_across_);
      const double period_m =
          std::min(kMinPeriod * grid.y_m.back(),
                   static_cast<double>(kMaxWide) * std::min(grid.spacing_x_m / 2, grid.spacing_z_m));
      const auto force_over = [&](double min_period_m) {
        check_cancelled();
        return force_of(wide_surface(grid, layers, tissue_.poisson_ratio, min_period_m), patch);
      };
      force_share_ = force_over(0) / force_over(period_m);
    }
    return *force_share_;
  }

 private:
  // The last tissue's where it is of the same layers on the same mesh; else that is let go first.
  std::shared_ptr<SolidSolver<float>> solver_of(std::shared_ptr<ProbedTissue> last) const {
    const auto* solid = dynamic_cast<const ProbedSolid*>(last.get());
    if (solid && solid->tissue_.grid == tissue_.grid && solid->face_.poisson_ratio == face_.poisson_ratio)
      return solid->solver_;
    last.reset();
    return std::make_shared<SolidSolver<float>>(queue_, tissue_);
  }

  Response pushed(const VectorXd& log_modulus, double tilt, const Planes& planes,
                  std::size_t min_iterations) {
    fill(log_modulus, planes);
    const auto& layers_pa = solver_->layers().youngs_modulus_pa;
    solver_->use(std::make_shared<const SolidModulus<float>>(queue_, tissue_, beside(tissue_, layers_pa)));
    const auto nodes = static_cast<Index>(cells_.columns + 1);
    VectorXd w(static_cast<Index>(patch_.unknowns.size()));
    for (Index n = 0; n < w.size(); ++n)
      w[n] = 1 + tilt * (2 * (static_cast<double>(n % nodes) + 0.5) / static_cast<double>(nodes) - 1);
    SolidOptions options;
    options.from_last = true, options.min_iterations = min_iterations;
    options.relative_error = face_.goes_on() ? kAccuracy : kAccuracyOfSides;
    const SolidSolution solution = solver_->push(patch_, w, options);
    if (solution.reason != StopReason::kConverged && !(solution.bounded_error() <= kMinAccuracy))
      throw std::invalid_argument(fmt::format(
          "probe_elevation_m, tissue_depth_m, poisson_ratio: a face of {:.3g} m x {:.3g} m on tissue {:.3g} "
          "m deep, nu {:.6g}, is beyond what is modelled ({}); check them, nu is about 0.49",
          face_.width_m, face_.elevation_m, face_.depth_m, face_.poisson_ratio, to_string(solution.reason)));
    Response out = strains(solver_->displacement());
    // The energy is as good as the displacement. Where the sides give way the nodes' forces are not: in
    // single precision their sum may be anything. A push by w bears w of its force, about.
    out.force_n = face_.goes_on() ? solution.force_n.sum()
                                  : 2 * solution.energy_j * static_cast<double>(w.size()) / w.squaredNorm();
    return out;
  }

  // Along the image and in depth: what the period changes of the force is wide, and so found in a quarter of
  // the time, to 1e-3.
  std::pair<SolidGrid, LayeredTissue> twice_as_coarse() const {
    SolidGrid grid = tissue_.grid;
    grid.nx /= 2, grid.spacing_x_m *= 2;
    grid.y_m = {0};
    std::vector<double> moduli_pa;
    const std::vector<double>& of_layer = solver_->layers().youngs_modulus_pa;
    for (std::size_t j = 0; j < of_layer.size();) {
      moduli_pa.push_back(of_layer[j]);
      j += j + 1 < of_layer.size() && of_layer[j + 1] == of_layer[j] ? 2 : 1;
      grid.y_m.push_back(tissue_.grid.y_m[j]);
    }
    return {grid, LayeredTissue{moduli_pa}};
  }

  void fill(const VectorXd& log_modulus, const Planes& planes) {
    const SolidGrid& grid = tissue_.grid;
    const auto columns = static_cast<Index>(cells_.columns);
    const std::vector<Between> places = places_of(log_modulus, planes);
    std::vector<double> row(grid.nx);
    for (std::size_t j = 0; j < grid.layers(); ++j) {
      check_cancelled();
      const Index first = static_cast<Index>(std::min(j, cells_.rows - 1)) * columns;
      const double below_m = (grid.y_m[j] + grid.y_m[j + 1]) / 2 - grid.y_m[cells_.rows],
                   seen = std::exp(-std::max(0.0, below_m) / kBelowM);
      for (std::size_t k = 0; k < grid.nz; ++k) {
        const Between& at = places[k];
        if (k == 0 || at != places[k - 1])
          fill_row(between(at.before->segment(first, columns), at.after->segment(first, columns), at.way),
                   seen, row);
        const std::size_t middle = (k + (nodes_across_ - 1) / 2) % grid.nz;  // across_ begins at its edge
        double* to = tissue_.youngs_modulus_pa.data() + grid.nx * (k + grid.nz * j);
        for (std::size_t n = 0; n < grid.nx; ++n)
          to[n] = row[n] * (kAir + (1 - kAir) * along_[n] * across_[middle]);
      }
    }
  }

  // Between which planes an element's middle lies, how far on the way from the one to the other.
  struct Between {
    const VectorXd *before, *after;
    double way;
    bool operator==(const Between&) const = default;
  };
  // Places of the elements across the image, the first of which begins in its plane.
  std::vector<Between> places_of(const VectorXd& log_modulus, const Planes& planes) const {
    const SolidGrid& grid = tissue_.grid;
    const auto behind = static_cast<std::ptrdiff_t>(
        std::ranges::count_if(planes, [](const ImagePlane& plane) { return plane.offset_m < 0; }));
    std::vector<std::pair<double, const VectorXd*>> all;
    for (const ImagePlane& plane : planes) all.emplace_back(plane.offset_m, &plane.log_modulus);
    all.insert(all.begin() + behind, {0.0, &log_modulus});
    std::vector<Between> places;
    for (std::size_t k = 0; k < grid.nz; ++k) {
      const double element = static_cast<double>(k) + 0.5,
                   at_m = (2 * k < grid.nz ? element : element - static_cast<double>(grid.nz)) *
                          grid.spacing_z_m;
      const auto after = std::ranges::find_if(all, [at_m](const auto& plane) { return plane.first > at_m; });
      if (after == all.begin() || after == all.end()) {
        const VectorXd* last = after == all.end() ? all.back().second : after->second;
        places.push_back({last, last, 0});
      } else {
        const auto before = std::prev(after);
        places.push_back(
            {before->second, after->second, (at_m - before->first) / (after->first - before->first)});
      }
    }
    return places;
  }

  // The one that differs more from the background changes to the other with the square of the way from it
  // (T3.9).
  static VectorXd between(const VectorXd& before, const VectorXd& after, double way) {
    const double to_after = way * way, to_before = (1 - way) * (1 - way);
    return (before.array().abs() > after.array().abs())
        .select(before + to_after * (after - before), after + to_before * (before - after));
  }

  // Moduli of the elements of a row, from the logarithms of its cells, of which the image shows so much
  // beyond their mean.
  void fill_row(VectorXd cells, double seen, std::vector<double>& row) const {
    cells = (cells.mean() + seen * (cells.array() - cells.mean())).matrix().eval();
    const Index columns = cells.size(),
                mirrored = std::min(columns, static_cast<Index>(kMirroredM / cells_.spacing_m)),
                all = static_cast<Index>(row.size());
    const double mean = std::exp(cells.mean());
    for (Index i = 0; i < all; ++i) {
      const Index right = i + 1 - columns, left = all - i;
      double& modulus = row[static_cast<std::size_t>(i)];
      if (i < columns)
        modulus = std::exp(cells[i]);
      else if (right <= left && right <= mirrored)
        modulus = std::exp(cells[columns - right]);
      else if (left < right && left <= mirrored)
        modulus = std::exp(cells[left - 1]);
      else
        modulus = mean;
    }
  }

  // In the plane of nodes under the face's middle; the last row of nodes rests.
  Response strains(const std::vector<float>& u) const {
    const SolidGrid& grid = tissue_.grid;
    const auto at = [&](std::size_t i, std::size_t j, std::size_t component) {
      return j < grid.layers() ? static_cast<double>(u[i + grid.columns() * (3 * j + component)]) : 0.0;
    };
    Response out;
    out.axial_strain.resize(static_cast<Index>(cells_.size()));
    out.lateral_strain.resize(static_cast<Index>(cells_.size()));
    for (std::size_t j = 0; j < cells_.rows; ++j)
      for (std::size_t i = 0; i < cells_.columns; ++i) {
        const auto cell = static_cast<Index>(i + cells_.columns * j);
        out.axial_strain[cell] = (at(i, j + 1, 1) + at(i + 1, j + 1, 1) - at(i, j, 1) - at(i + 1, j, 1)) /
                                 (2 * (grid.y_m[j + 1] - grid.y_m[j]));
        out.lateral_strain[cell] =
            (at(i + 1, j, 0) + at(i + 1, j + 1, 0) - at(i, j, 0) - at(i, j + 1, 0)) / (2 * cells_.spacing_m);
      }
    return out;
  }

  ProbeFace face_;
  std::size_t nodes_across_;
  SolidTissue tissue_;
  Charge held_;                         // of its moduli
  std::vector<double> along_, across_;  // of elements: the share that lies within the tissue
  SurfacePatch patch_;
  Queue queue_;
  std::shared_ptr<SolidSolver<float>> solver_;
  std::optional<double> force_share_;
};

}  // namespace

std::shared_ptr<ProbedTissue> make_probed_solid(const Queue& queue, const ProbeFace& face, double cell_m,
                                                std::shared_ptr<ProbedTissue> last) {
  return std::make_shared<ProbedSolid>(queue, face, cell_m, std::move(last));
}

}  // namespace teletact::service
