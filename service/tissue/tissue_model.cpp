#include "service/tissue/tissue_model.h"

#include <fmt/format.h>

#include <stdexcept>
#include <utility>
#include <vector>

#include "service/device/device.h"
#include "service/tissue/condensed_compliances.h"
#include "service/tissue/iterative_compliances.h"

namespace teletact::service {
namespace {

std::size_t bytes_of(const TissueGrid& grid) {
  return (grid.elements() + grid.nx() + grid.ny()) * sizeof(double);
}

}  // namespace

TissueModel::TissueModel(TissueGrid grid, Material material, Supports supports,
                         const TissueModelOptions& options, const TissueModel* before)
    : problem_(std::make_shared<const TissueProblem>(
          make_problem(std::move(grid), std::move(material), supports, options))),
      charge_(options.account.charge(Place::kHost, "models", bytes_of(problem_->grid))),
      condensed_(
          std::make_shared<CondensedCompliances>(problem_, options, before ? before->condensed_ : nullptr)),
      iterative_(std::make_shared<IterativeCompliances>(problem_, options.account)) {
  options.account.add(Place::kHost, condensed_);
  options.account.add(Place::kHost, iterative_);
}

void TissueModel::check_free(std::size_t row) const {
  const FreeNodes free = free_nodes(problem_->grid, problem_->supports);
  if (row < free.first_row || row > free.last_row)
    throw std::out_of_range(fmt::format("row {} cannot be touched: it is fixed or absent; rows {} to {} can",
                                        row, free.first_row, free.last_row));
}

std::shared_ptr<Compliance> TissueModel::compliance(std::size_t row,
                                                    const std::shared_ptr<Device>& device) const {
  check_free(row);
  return device ? iterative_->at(row, device) : condensed_->at(row);
}

std::shared_ptr<Compliance> TissueModel::ready(std::size_t row, const std::shared_ptr<Device>& device) const {
  check_free(row);
  return device ? iterative_->find(row, device) : condensed_->find(row);
}

void warm_iterative(const std::shared_ptr<Device>& device) {
  constexpr std::size_t kColumns = 120, kRows = 33;
  const TissueGrid grid{uniform_coordinates(0, 0.120, kColumns), uniform_coordinates(0, 0.040, kRows)};
  std::vector<double> poisson_ratios{0.49};
  if (!device->info().has_double) poisson_ratios.push_back(0.499);  // refined
  for (const double poisson_ratio : poisson_ratios) {
    const Material material{std::vector<double>(grid.elements(), 10e3), poisson_ratio};
    const TissueModel model(grid, material, {}, {});
    for (const std::size_t count : {1, 2}) {  // right-hand sides
      std::vector<std::size_t> nodes(count);
      for (std::size_t n = 0; n < count; ++n) nodes[n] = kColumns / 2 + 2 * n + count;
      model.compliance(0, device)->axial_among(nodes, nullptr);
    }
  }
}

}  // namespace teletact::service
