// Contact on solid tissue where the device fails, and at a contrast that float cannot hold: an error that
// says why, or an answer that says what it is off by; never a number that is none.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <string>

#include "service/contact/fingertip.h"
#include "service/contact/solid_contact.h"
#include "tests/reference/solid.h"
#include "tests/solver/block_stencil.h"
#include "tests/support/faulty_kernels.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

SolidTissue with_ball(double contrast) {
  return solid({32, 16, 0.002, 0.0025, graded_rows(0.020, 6, 1.2)}, 0.49,
               [contrast](double x, double y, double z) {
                 return std::hypot(x - 0.03, y - 0.008, z - 0.02) < 0.006 ? contrast * 1e4 : 1e4;
               });
}
constexpr Vector3 kPose{0.0312, 0.0018, 0.0193};

class FaultySolid : public FaultyKernels {
 protected:
  // Touched twice: what a failure has left must not be believed afterwards.
  void expect_error(const std::string& why) {
    SolidContact<float> contact(Device::open(options_)->queue(), with_ball(10));
    for (int k = 0; k < 2; ++k) {
      try {
        const ContactAnswer a = contact.touch({}, kPose);
        ADD_FAILURE() << "touch " << k << " gave " << a.force_n[1] << " N, stated " << a.solve.relative_error;
      } catch (const std::domain_error& error) {
        EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
      }
    }
  }
};

TEST_F(FaultySolid, NanInTheModuliIsSaid) {
  sabotage("solid.cl", "const vec e = LOAD(modulus + (layer * nz + z) * nx + i);",
           "const vec e = LOAD(modulus + (layer * nz + z) * nx + i) * (i == WIDTH && k == 3 && layer == 2 ? "
           "(real)NAN : 1);");
  expect_error("broke down (not finite)");
}

TEST_F(FaultySolid, NanFromTheLayersIsSaid) {
  sabotage("solid.cl", "STORE(LOAD(r + at) - alpha", "STORE((real)NAN * LOAD(r + at) - alpha");
  expect_error("broke down (not finite)");
}

// The displacement alone: no scalar of the iteration sees it, and the next contact would be found on it.
TEST_F(FaultySolid, NanInTheDisplacementIsSaid) {
  sabotage("solid.cl", "STORE(LOAD(u + at) + alpha", "STORE((real)NAN * LOAD(u + at) + alpha");
  expect_error("not finite");
}

TEST_F(FaultySolid, WithoutRoomItIsNotMade) {
  options_.max_array_bytes = 10000;
  try {
    SolidContact<float> contact(Device::open(options_)->queue(), with_ball(10));
    FAIL() << "it was made";
  } catch (const std::exception& error) {
    EXPECT_NE(std::string(error.what()).find("exceeds the 10000 that"), std::string::npos) << error.what();
  }
}

// What a contact's force is off by: one step of Newton's with the sparse factor's compliance.
double true_error(const SolidTissue& tissue, const ContactAnswer& answer) {
  const SolidGrid& grid = tissue.grid;
  const double area = grid.spacing_x_m * grid.spacing_z_m;
  std::vector<std::size_t> nodes;
  Eigen::VectorXd p(Eigen::Index(answer.pressure.size())), off(p.size());
  for (const NodalPressure& node : answer.pressure) {
    p[Eigen::Index(nodes.size())] = node.pressure_pa * area;
    nodes.push_back(reference::unknown(grid, std::size_t(std::lround(node.position_m[0] / grid.spacing_x_m)),
                                       0, std::size_t(std::lround(node.position_m[2] / grid.spacing_z_m)),
                                       1));
  }
  const LayeredTissue layers = layered(tissue);
  const SurfaceCompliance wide = wide_surface(grid, layers, 0.49, choices::kMinPeriod * grid.y_m.back());
  Eigen::MatrixXd s = reference::SolidReference(tissue).compliance(nodes) + wide.among(nodes) -
                      wide_surface(grid, layers, 0.49, 0).among(nodes);
  off = -(s * p);
  const SkinThickness skin = skin_thickness({}, kPose[1], std::sqrt(area));
  for (Eigen::Index n = 0; n < p.size(); ++n) {
    const Vector3& at = answer.pressure[std::size_t(n)].position_m;
    const double r = std::hypot(at[0] - kPose[0], at[2] - kPose[2]);
    const SkinState state = skin_state(p[n], kSkinStiffness / wide(1, 1, 0, 0), skin.t_m);
    off[n] += kPose[1] - r * r / (2 * Fingertip{}.radius_m) + state.gap_m;
    s(n, n) += state.compliance;
  }
  return std::abs(s.ldlt().solve(off).sum() / p.sum());
}

TEST(ExtremeContrast, EndsWithAnErrorOrSaysWhatItIsOffBy) {
  const Queue queue = test_device()->queue();
  const SolidTissue tissue = with_ball(1e6);
  const auto touch = [&](auto&& contact, double asked) {
    try {
      const ContactAnswer a = contact.touch({}, kPose, {.force_error = asked});
      const double error = true_error(tissue, a);
      EXPECT_LE(error, a.solve.relative_error) << "asked " << asked << ", ended by " << a.solve.reason;
      EXPECT_LE(error, a.solve.converged ? asked : HUGE_VAL);
      return true;
    } catch (const std::domain_error& e) {
      EXPECT_NE(std::string(e.what()).find("not positive definite"), std::string::npos) << e.what();
      return false;
    }
  };
  touch(SolidContact<float>(queue, tissue), choices::kSolidForceError);
  if (!queue.supports(Precision::kDouble)) return;
  for (const double asked : {choices::kSolidForceError, 1e-6})
    EXPECT_TRUE(touch(SolidContact<double>(queue, tissue), asked)) << "in double it is solved";
}

}  // namespace
}  // namespace teletact::service
