#include "service/tissue/tissue_model.h"

#include <utility>
#include <vector>

#include "service/device/device.h"
#include "service/tissue/iterative_lines.h"
#include "service/tissue/line_cache.h"
#include "service/tissue/line_condenser.h"

namespace teletact::service {
namespace {

std::size_t bytes_of(const TissueProblem& problem) {
  const TissueGrid& grid = problem.grid;
  return (grid.elements() + grid.nx() + grid.ny()) * sizeof(double);
}

}  // namespace

TissueModel::TissueModel(TissueGrid grid, Material material, Supports supports,
                         const TissueModelOptions& options, const TissueModel* before)
    : problem_(std::make_shared<const TissueProblem>(
          make_problem(std::move(grid), std::move(material), supports, options.thickness_m,
                       options.touch_begin_m, options.touch_end_m))),
      charge_(options.account.charge(Place::kHost, "models", bytes_of(*problem_))),
      condenser_(std::make_shared<LineCondenser>(
          problem_, CondenserOptions{options.interior_lines, options.will_change, options.most_line_bytes},
          options.account)),
      surface_(condenser_->free().first_line > 0
                   ? nullptr
                   : condenser_->condense(0, before ? before->condenser_.get() : nullptr)),
      interior_(std::make_shared<LineCache>(
          problem_->grid.ny(),
          options.most_line_bytes / (condenser_->line_bytes() + condenser_->sides_bytes()),
          [condenser = condenser_](std::size_t line) { condenser->forget(line); })),
      iterative_(std::make_shared<IterativeLines>(problem_, options.account)) {
  options.account.add(Place::kHost, interior_);
  options.account.add(Place::kHost, iterative_);
}

TissueModel::~TissueModel() = default;

std::shared_ptr<Compliance> TissueModel::condensed(std::size_t line, const TissueModel* before) const {
  condenser_->check_free(line);
  if (line == 0) return surface_;
  return interior_->get(
      line, [&] { return condenser_->condense(line, before ? before->condenser_.get() : nullptr); });
}

std::shared_ptr<Compliance> TissueModel::made(std::size_t line) const {
  condenser_->check_free(line);
  return line == 0 ? surface_ : interior_->find(line);
}

std::shared_ptr<Compliance> TissueModel::iterative(std::size_t line,
                                                   const std::shared_ptr<Device>& device) const {
  condenser_->check_free(line);
  return iterative_->at(line, device);
}

std::shared_ptr<Compliance> TissueModel::iterative(std::size_t line, const std::shared_ptr<Device>& device,
                                                   const ElasticitySolverOptions& options) const {
  condenser_->check_free(line);
  return iterative_->make(line, device, options);
}

std::size_t TissueModel::line_bytes() const {
  return condenser_->line_bytes();
}

double TissueModel::line_operations() const {
  return condenser_->operations();
}

void warm_iterative(const std::shared_ptr<Device>& device) {
  constexpr std::size_t kColumns = 120, kLines = 33;
  const TissueGrid grid{uniform_coordinates(0, 0.120, kColumns), uniform_coordinates(0, 0.040, kLines)};
  std::vector<double> poisson_ratios{0.49};
  if (!device->info().has_double) poisson_ratios.push_back(0.499);  // refined
  for (const double poisson_ratio : poisson_ratios) {
    const Material material{std::vector<double>(grid.elements(), 10e3), poisson_ratio};
    const TissueModel model(grid, material, {}, {});
    for (const std::size_t count : {1, 2}) {  // right-hand sides
      std::vector<std::size_t> nodes(count);
      for (std::size_t n = 0; n < count; ++n) nodes[n] = kColumns / 2 + 2 * n + count;
      model.iterative(0, device)->axial_among(nodes, nullptr);
    }
  }
}

}  // namespace teletact::service
