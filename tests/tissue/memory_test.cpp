// Models under a small budget of memory: what they keep stays within it, what was given back is made again
// when it is asked for, and the numbers are the same to the error that is stated with them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "service/base/limits.h"
#include "service/base/memory.h"
#include "service/device/device.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {
namespace {

const std::shared_ptr<Device>& device() {
  static const std::shared_ptr<Device> opened = Device::open();
  return opened;
}

struct Budget {
  Budget(std::uint64_t host, std::uint64_t on_device) {
    Limits limits;
    limits.host_memory_bytes = host, limits.device_memory_bytes = on_device, limits.client_memory_share = 1;
    memory = std::make_shared<MemoryBudget>(limits);
  }
  TissueModelOptions options(bool will_change = false) const {
    TissueModelOptions o;
    o.account = {memory, "anna", "liver"};
    o.will_change = will_change;
    return o;
  }
  std::uint64_t held(Place place = Place::kHost) const { return memory->held(place); }
  std::uint64_t held(const std::string& kind) const {
    std::uint64_t bytes = 0;
    for (const MemoryUse& use : memory->uses())
      if (use.kind == kind) bytes += use.bytes;
    return bytes;
  }
  std::shared_ptr<MemoryBudget> memory;
};

constexpr std::size_t kColumns = 96, kRows = 48;
constexpr std::uint64_t kSolvingBytes = 14 * 8 * 2 * (kColumns + 1) * (kRows + 1);  // a column, meanwhile

TissueGrid wide_grid() {
  return {uniform_coordinates(0, 0.1, kColumns), uniform_coordinates(0, 0.05, kRows)};
}

Material with_inclusion() {
  Material material{std::vector<double>(kColumns * kRows, 10e3), 0.45};
  for (std::size_t j = 8; j < 16; ++j)
    for (std::size_t i = 40; i < 56; ++i) material.youngs_modulus_pa[i + kColumns * j] = 50e3;
  return material;
}

std::vector<std::size_t> around(std::size_t column) {
  return {column - 1, column, column + 1};
}

// Positions all along several rows: far more columns than there is room for.
TEST(ModelMemory, GradientColumnsStayWithinTheBudget) {
  const std::uint64_t column = 12 * wide_grid().dofs(),
                      columns_bytes = 24 * column + 6 * kSolvingBytes;  // while six are solved
  const Budget unbounded(std::uint64_t{1} << 40, std::uint64_t{1} << 40);
  const TissueModel free_model(wide_grid(), with_inclusion(), {}, unbounded.options());
  std::vector<std::shared_ptr<Compliance>> free_compliances;
  for (const std::size_t row : {0, 5, 12}) free_compliances.push_back(free_model.compliance(row, device()));
  const std::uint64_t fixed = unbounded.held();  // model, matrices of three rows, solver
  const Budget budget(fixed + columns_bytes, std::uint64_t{1} << 40);
  const TissueModel model(wide_grid(), with_inclusion(), {}, budget.options());
  std::size_t k = 0;
  for (const std::size_t row : {0, 5, 12}) {
    const auto touched = model.compliance(row, device());
    for (const std::size_t at : {10, 30, 50, 70, 85, 10}) {
      const auto nodes = around(at);
      SolveReport report, free_report;
      const Eigen::MatrixXd c = touched->among(nodes, &report),
                            expected = free_compliances[k]->among(nodes, &free_report);
      const double error = 2 * (report.relative_error + free_report.relative_error);
      const Eigen::VectorXd scale = expected.diagonal().cwiseSqrt();
      EXPECT_LE(((c - expected).array() / (scale * scale.transpose()).array()).abs().maxCoeff(), error);
      EXPECT_LE(budget.held(), fixed + columns_bytes);
      EXPECT_GE(budget.held("columns"), 6 * column) << "what was asked for last is kept";
    }
    ++k;
  }
  EXPECT_GT(unbounded.held("columns"), columns_bytes) << "without a bound they are all kept";
}

TEST(ModelMemory, WhatOneAnswerNeedsAtOnceIsHeldTogetherOrRefused) {
  const Budget budget(std::uint64_t{1} << 40, std::uint64_t{1} << 40);
  const TissueModel first(wide_grid(), with_inclusion(), {}, budget.options());
  const auto row = first.compliance(0, device());
  const std::uint64_t fixed = budget.held(), column = 12 * wide_grid().dofs();
  const Budget tight(fixed + 20 * column + 3 * kSolvingBytes, std::uint64_t{1} << 40);
  const TissueModel model(wide_grid(), with_inclusion(), {}, tight.options());
  const auto touched = model.compliance(0, device());
  std::vector<std::size_t> many;
  for (std::size_t i = 20; i < 60; ++i) many.push_back(i);
  EXPECT_THROW(touched->axial_among(many, nullptr), MemoryRefused);
  EXPECT_LE(tight.held(), fixed + 20 * column + 3 * kSolvingBytes);
  EXPECT_NO_THROW(touched->axial_among(std::vector<std::size_t>{29, 30, 31}, nullptr))
      << "less fits, also after a refusal";
}

TEST(ModelMemory, ASolverThatNobodyUsesGivesTheDeviceBack) {
  const Budget unbounded(std::uint64_t{1} << 40, std::uint64_t{1} << 40);
  std::uint64_t most = 0;
  {
    const TissueModel model(wide_grid(), with_inclusion(), {}, unbounded.options());
    model.compliance(0, device())->among(around(50), nullptr);
    most = unbounded.held(Place::kDevice);
    EXPECT_GT(most, 0U);
  }
  EXPECT_EQ(unbounded.held(Place::kDevice), 0U);
  EXPECT_EQ(unbounded.held(), 0U);
  const Budget budget(std::uint64_t{1} << 40, most + most / 2);
  const TissueModel a(wide_grid(), with_inclusion(), {}, budget.options()),
      b(wide_grid(), with_inclusion(), {}, budget.options());
  const auto of_a = a.compliance(0, device()), of_b = b.compliance(0, device());
  const Eigen::MatrixXd before = of_a->among(around(50), nullptr);
  for (const std::size_t at : {20, 30, 40}) {  // in turns: each takes the other's place
    EXPECT_NO_THROW(of_b->among(around(at), nullptr));
    EXPECT_NO_THROW(of_a->among(around(at), nullptr));
    EXPECT_LE(budget.held(Place::kDevice), most + most / 2);
  }
  EXPECT_EQ(of_a->among(around(50), nullptr), before);
  const Budget none(std::uint64_t{1} << 40, 1000);
  const TissueModel c(wide_grid(), with_inclusion(), {}, none.options());
  EXPECT_THROW(c.compliance(0, device()), MemoryRefused);
  EXPECT_EQ(none.held(Place::kDevice), 0U);
}

TEST(ModelMemory, LayersAreGivenBackAndLargeModelsRefused) {
  const Budget unbounded(std::uint64_t{1} << 40, 0);
  std::uint64_t with_one = 0;
  {
    const TissueModel model(wide_grid(), with_inclusion(), {}, unbounded.options(true));
    EXPECT_GT(unbounded.held(), 0U);
    model.compliance(3);
    with_one = unbounded.held();
  }
  EXPECT_EQ(unbounded.held(), 0U);
  // Room for the work on one more row beside what is kept.
  const std::uint64_t slack = 4 * 4 * kColumns * kColumns * sizeof(double);
  const Budget budget(with_one + slack, 0);
  const TissueModel model(wide_grid(), with_inclusion(), {}, budget.options(true));
  const Eigen::MatrixXd third = model.compliance(3)->among(around(50), nullptr);
  for (const std::size_t row : {4, 5}) EXPECT_NO_THROW(model.compliance(row));
  EXPECT_LE(budget.held(), with_one + slack);
  EXPECT_EQ(model.compliance(3)->among(around(50), nullptr), third);
  const Budget small(10000, 0);
  EXPECT_THROW(TissueModel(wide_grid(), with_inclusion(), {}, small.options()), MemoryRefused);
  EXPECT_EQ(small.held(), 0U);
}

}  // namespace
}  // namespace teletact::service
