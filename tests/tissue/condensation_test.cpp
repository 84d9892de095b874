#include "service/tissue/condensation.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "service/tissue/element.h"
#include "service/tissue/tissue_model.h"
#include "tests/reference/elasticity.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using service::EdgeSupport;
using service::Material;
using service::Supports;
using service::TissueGrid;
using service::TissueModel;

// B K^-1 B^T over the given columns of a row, by a sparse factor of the reference assembly.
MatrixXd reference_compliance(const TissueGrid& grid, const Material& material, const Supports& supports,
                              std::size_t row, const std::vector<std::size_t>& columns) {
  const auto k =
      reference::with_fixed(reference::assemble(grid, material), reference::fixed_dofs(grid, supports));
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(k);
  MatrixXd s(Index(2 * columns.size()), Index(2 * columns.size()));
  for (std::size_t b = 0; b < 2 * columns.size(); ++b) {
    VectorXd f = VectorXd::Zero(k.rows());
    f[Index(2 * grid.node(columns[b / 2], row) + b % 2)] = 1;
    const VectorXd u = factor.solve(f);
    for (std::size_t a = 0; a < 2 * columns.size(); ++a) {
      s(Index(a), Index(b)) = u[Index(2 * grid.node(columns[a / 2], row) + a % 2)];
    }
  }
  return s;
}

double relative_difference(const MatrixXd& a, const MatrixXd& b) {
  return (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
}

std::vector<std::size_t> range(std::size_t first, std::size_t last) {
  std::vector<std::size_t> v(last - first + 1);
  std::iota(v.begin(), v.end(), first);
  return v;
}

TEST(Element, ClosedFormEqualsQuadrature) {
  for (double nu : {0.0, 0.3, 0.49, 0.4999}) {
    const auto product = service::element_stiffness(2e-3, 7e-3, 12e3, nu);
    const auto quadrature =
        reference::element_matrix(2e-3, 7e-3, 12e3, nu, reference::Integration::kSelectiveReduced);
    EXPECT_LE(relative_difference(product, quadrature), 1e-13) << nu;
  }
}

TEST(Condensation, SymmetricInverseOfAwkwardSizes) {
  for (Index n : {1, 2, 7, 32, 33, 65, 101, 222}) {
    const MatrixXd random = MatrixXd::Random(n, n);
    const MatrixXd a = random * random.transpose() + 0.1 * double(n) * MatrixXd::Identity(n, n);
    MatrixXd inverse = a;
    service::invert_symmetric(inverse);
    const MatrixXd full = inverse.selfadjointView<Eigen::Lower>();
    EXPECT_LE((full * a - MatrixXd::Identity(n, n)).cwiseAbs().maxCoeff(), 1e-12) << n;
  }
}

TEST(Condensation, IndefiniteMatrixIsRefused) {
  for (Index n : {3, 70}) {
    MatrixXd a = MatrixXd::Identity(n, n);
    a(n - 2, n - 2) = -1;
    EXPECT_THROW(service::invert_symmetric(a), std::domain_error);
    a(n - 2, n - 2) = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(service::invert_symmetric(a), std::domain_error);
  }
}

TEST(Condensation, EveryRowEqualsSparseFactor) {
  for (const auto& [nx, ny] : {std::pair{17, 9}, {9, 26}, {41, 3}}) {
    const TissueGrid grid = tests::uneven_grid(nx, ny);
    const auto columns = range(0, grid.nx() - 1);
    for (double nu : {0.0, 0.3, 0.495, 0.4999}) {
      for (double contrast : {1.0, 100.0, 1e4}) {
        const Material material = tests::scattered(grid, contrast, nu);
        const TissueModel model(grid, material, Supports{}, {.interior_layers = contrast > 1});
        for (std::size_t row = 0; row + 1 < grid.ny(); ++row) {
          const MatrixXd expected = reference_compliance(grid, material, Supports{}, row, columns);
          service::SolveReport report;
          const MatrixXd s = model.compliance(row)->among(columns, &report);
          EXPECT_LE(relative_difference(s, expected), report.relative_error)
              << nx << "x" << ny << " row " << row << " nu " << nu << " contrast " << contrast;
          EXPECT_LE(report.relative_error, contrast <= 100 && nu < 0.499 ? 1e-6 : 1e-3);
          EXPECT_LE(relative_difference(s, s.transpose()), 1e-15);
          EXPECT_EQ(Eigen::LLT<MatrixXd>(s).info(), Eigen::Success);
        }
      }
    }
  }
}

TEST(Condensation, AnyEdgeMayBeFixed) {
  const TissueGrid grid = tests::uneven_grid(11, 8);
  const Material material = tests::scattered(grid, 10, 0.49);
  for (int mask = 1; mask < 16; ++mask) {
    const auto edge = [&](int bit) { return mask & bit ? EdgeSupport::kFixed : EdgeSupport::kFree; };
    const Supports supports{edge(1), edge(2), edge(4), edge(8)};
    const TissueModel model(grid, material, supports, {});
    const service::ColumnRange touchable = model.problem().touchable;
    EXPECT_EQ(touchable.first, mask & 4 ? 1u : 0u);
    EXPECT_EQ(touchable.last, grid.nx() - (mask & 8 ? 2u : 1u));
    const auto columns = range(touchable.first, touchable.last);
    for (std::size_t row : {0u, 3u, 7u}) {
      const bool fixed = (row == 0 && (mask & 1)) || (row == 7 && (mask & 2));
      if (fixed) {
        EXPECT_THROW(model.compliance(row), std::out_of_range);
        continue;
      }
      const MatrixXd expected = reference_compliance(grid, material, supports, row, columns);
      EXPECT_LE(relative_difference(model.compliance(row)->among(columns, nullptr), expected), 1e-10)
          << "mask " << mask << " row " << row;
    }
  }
}

TEST(TissueModel, ComplianceIsKeptAmongTouchableColumnsAlone) {
  const TissueGrid grid = tests::uniform_grid(21, 6);
  const Material material = tests::inclusion(grid, 10, 0.49);
  const TissueModel model(grid, material, Supports{}, {.touch_begin_m = 0.005, .touch_end_m = 0.0121});
  EXPECT_EQ(model.problem().touchable.first, 5u);
  EXPECT_EQ(model.problem().touchable.last, 12u);
  const std::vector<std::size_t> nodes{5, 8, 12};
  for (std::size_t row : {0u, 2u}) {
    EXPECT_LE(relative_difference(model.compliance(row)->among(nodes, nullptr),
                                  reference_compliance(grid, material, Supports{}, row, nodes)),
              1e-11);
    EXPECT_THROW(model.compliance(row)->among(std::vector<std::size_t>{4, 5}, nullptr), std::out_of_range);
    EXPECT_THROW(model.compliance(row)->among(std::vector<std::size_t>{13}, nullptr), std::out_of_range);
  }
  EXPECT_THROW(model.compliance(5), std::out_of_range);  // the fixed bottom
  EXPECT_THROW(model.compliance(60), std::out_of_range);
}

TEST(TissueModel, ModulusNearAColumnIsTheMeanOfBothSides) {
  const TissueGrid grid = tests::uniform_grid(3, 3, 0.01);
  const TissueModel model(grid, Material{{1e3, 3e3, 5e3, 9e3}, 0.49}, {}, {});
  EXPECT_EQ(modulus_near_pa(model.problem(), 0, 0), 1e3);
  EXPECT_EQ(modulus_near_pa(model.problem(), 1, 0), 2e3);
  EXPECT_EQ(modulus_near_pa(model.problem(), 2, 0), 3e3);
  EXPECT_EQ(modulus_near_pa(model.problem(), 1, 1), 7e3);
  EXPECT_EQ(modulus_near_pa(model.problem(), 1, 2), 7e3);  // the lowest row has elements above it alone
}

// Two of them fit, so that none is made row by row, which makes all at once.
TEST(TissueModel, InteriorLayersUsedLastAreKept) {
  const TissueGrid grid = tests::uniform_grid(21, 9);
  const Material material = tests::inclusion(grid, 10, 0.49);
  const auto columns = range(0, 20);
  const TissueModel model(grid, material, Supports{}, {.max_compliance_bytes = 2 * 8 * 42 * 42});
  const std::weak_ptr<service::Compliance> one = model.compliance(1), two = model.compliance(2);
  const MatrixXd of_two = model.compliance(2)->among(columns, nullptr);
  model.compliance(1);
  const auto three = model.compliance(3);
  EXPECT_FALSE(one.expired());
  EXPECT_TRUE(two.expired());
  EXPECT_EQ(model.compliance(2)->among(columns, nullptr), of_two);
  EXPECT_TRUE(one.expired());
  for (std::size_t row = 4; row < 8; ++row)
    EXPECT_LE(relative_difference(model.compliance(row)->among(columns, nullptr),
                                  reference_compliance(grid, material, Supports{}, row, columns)),
              1e-11);
  EXPECT_EQ(model.compliance(3), three);  // somebody holds it
}

// Rows that were made row by row and dropped are made again too.
TEST(TissueModel, InteriorLayersAreMadeAgainWhicheverWay) {
  const TissueGrid grid = tests::uniform_grid(11, 30);
  const Material material = tests::inclusion(grid, 10, 0.49);
  const auto columns = range(0, 10);
  const TissueModel model(grid, material, Supports{}, {.max_compliance_bytes = 29 * 22 * 22 * 8});
  for (int pass = 0; pass < 2; ++pass)
    for (std::size_t row = 1; row < 29; ++row)
      EXPECT_LE(relative_difference(model.compliance(row)->among(columns, nullptr),
                                    reference_compliance(grid, material, Supports{}, row, columns)),
                1e-10)
          << "pass " << pass << " row " << row;
}

TEST(TissueModel, RowsAreCondensedOnceAmongManyThreads) {
  const TissueGrid grid = tests::uniform_grid(21, 11);
  const Material material = tests::inclusion(grid, 10, 0.49);
  const TissueModel model(grid, material, Supports{}, {});
  std::vector<service::Compliance*> seen(40);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t row = 0; row < 10; ++row) seen[10 * t + row] = model.compliance(row).get();
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (std::size_t row = 0; row < 10; ++row) {
    EXPECT_NE(seen[row], nullptr);
    for (std::size_t t = 1; t < 4; ++t) EXPECT_EQ(seen[10 * t + row], seen[row]);
  }
}

template <class Make>
std::string message_of(Make&& make) {
  try {
    make();
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "nothing thrown";
}

TEST(TissueModel, UnusableInputIsRefusedByName) {
  const TissueGrid grid = tests::uniform_grid(5, 4);
  const Material good = tests::inclusion(grid, 10, 0.49);
  const auto refusal = [&](TissueGrid g, Material m, Supports s, service::TissueModelOptions o) {
    return message_of([&] { TissueModel(std::move(g), std::move(m), s, o); });
  };
  const auto expect_names = [](const std::string& message, const std::string& field) {
    EXPECT_NE(message.find(field), std::string::npos) << message << " does not name " << field;
  };
  for (double modulus :
       {0.0, -1e4, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    Material bad = good;
    bad.youngs_modulus_pa[7] = modulus;
    expect_names(refusal(grid, bad, {}, {}), "material.youngs_modulus_pa[7]");
  }
  for (double nu : {-0.1, 0.5, 0.7, std::numeric_limits<double>::quiet_NaN()}) {
    Material bad = good;
    bad.poisson_ratio = nu;
    expect_names(refusal(grid, bad, {}, {}), "material.poisson_ratio");
  }
  Material few = good;
  few.youngs_modulus_pa.pop_back();
  expect_names(refusal(grid, few, {}, {}), "material.youngs_modulus_pa");
  TissueGrid bad_grid = grid;
  bad_grid.x_m[2] = bad_grid.x_m[1];
  expect_names(refusal(bad_grid, good, {}, {}), "grid.x_m[2]");
  bad_grid = grid;
  bad_grid.y_m[0] = -1e-3;
  expect_names(refusal(bad_grid, good, {}, {}), "grid.y_m[0]");
  bad_grid.y_m[0] = 5e-324;
  expect_names(refusal(bad_grid, good, {}, {}), "grid.y_m[0] is 5e-324");
  const Supports free_body{EdgeSupport::kFree, EdgeSupport::kFree, EdgeSupport::kFree, EdgeSupport::kFree};
  expect_names(refusal(grid, good, free_body, {}), "supports");
  expect_names(refusal(grid, good, {}, {.thickness_m = 0}), "options.thickness_m");
  expect_names(refusal(grid, good, {}, {.touch_begin_m = 0.0011, .touch_end_m = 0.0019}),
               "options.touch_begin_m");
  expect_names(refusal(grid, good, {}, {.touch_begin_m = 0.003, .touch_end_m = 0.001}),
               "options.touch_begin_m");
}

}  // namespace
}  // namespace teletact
