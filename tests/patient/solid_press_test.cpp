#include "client/patient/solid_press.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <numbers>

#include "client/patient/true_modulus.h"

namespace teletact::client {
namespace {

constexpr double kPushM = 4e-4;

// A block of even tissue under a probe as wide as it, or in its middle.
Tissue block(double width_m, double depth_m, double elevational_width_m) {
  Tissue t;
  t.width_m = width_m, t.depth_m = depth_m;
  t.probe.width_m = std::min(.06, width_m);
  t.solid.emplace();
  t.solid->elevational_width_m = elevational_width_m;
  return t;
}

double middle_window(const Tissue& t) {
  return (t.width_m - t.probe.width_m) / 2;
}

ProbeState press(const Tissue& t, double spacing_m = .002) {
  return press_solid(t, middle_window(t), kPushM, spacing_m);
}

TEST(BoxStiffness, StoresEnergyOfStrainNotOfRigidMotion) {
  const std::array<double, 3> sides{5e-4, 7e-4, 4e-4};
  const double nu = .49, mu = 1 / (2 * (1 + nu)), lambda = nu / ((1 + nu) * (1 - 2 * nu));
  const auto k = box_stiffness(sides, nu);
  const Eigen::Map<const Eigen::Matrix<double, 24, 24, Eigen::RowMajor>> matrix(k.data());
  EXPECT_LE((matrix - matrix.transpose()).cwiseAbs().maxCoeff(), 1e-12);
  const auto energy = [&](const Eigen::Matrix3d& gradient) {
    Eigen::Matrix<double, 24, 1> u;
    for (int n = 0; n < 8; ++n)
      u.segment<3>(3 * n) =
          gradient * Eigen::Vector3d(n % 2 * sides[0], n / 2 % 2 * sides[1], n / 4 * sides[2]) +
          Eigen::Vector3d(.3, -.2, .1);
    return .5 * u.dot(matrix * u);
  };
  const auto exact = [&](const Eigen::Matrix3d& gradient) {
    const Eigen::Matrix3d strain = (gradient + gradient.transpose()) / 2;
    return sides[0] * sides[1] * sides[2] *
           (mu * strain.squaredNorm() + .5 * lambda * strain.trace() * strain.trace());
  };
  Eigen::Matrix3d turn, any;
  turn << 0, 1, -2, -1, 0, 3, 2, -3, 0;
  any << .3, -.1, .4, .2, -.7, .5, .1, .6, -.2;
  EXPECT_NEAR(energy(turn), 0, 1e-16);
  EXPECT_NEAR(energy(any) / exact(any), 1, 1e-9);
}

// All of the surface pressed, everything free to slide: one stress everywhere.
TEST(SolidPress, UniaxialStressIsExact) {
  Tissue t = block(.05, .03, .01);
  t.solid->support = Support::kSliding;
  const ProbeState state = press(t);
  const double strain = kPushM / t.depth_m;
  EXPECT_NEAR(state.force_n / (t.youngs_modulus_pa * strain * t.width_m * .01), 1, 3e-4);
  const auto middle = state.field->at(.025, .01, 0), away = state.field->at(.045, .01, .004);
  EXPECT_NEAR(middle.y / (kPushM * 2 / 3), 1, 1e-3);
  EXPECT_NEAR((away.x - middle.x) / (.49 * strain * .02), 1, 1e-3);
  EXPECT_NEAR((away.z - middle.z) / (.49 * strain * .004), 1, 1e-3);
  EXPECT_NEAR(state.field->at(.045, .01, -.004).z, -away.z, 1e-12);
}

// Wide and shallow, held below: its middle can only be compressed, with the oedometric modulus.
TEST(SolidPress, MiddleOfAWidePlateIsOedometric) {
  Tissue t = block(.12, .006, .12);
  t.poisson_ratio = .3;
  t.probe.width_m = .12, t.probe.elevation_m = .12;
  t.solid->friction = std::numeric_limits<double>::infinity();
  const ProbeState state = press(t, .003);
  for (const double y : {.001, .003, .005})
    EXPECT_NEAR(state.field->at(.06, y).y, kPushM * (1 - y / .006), 1e-3 * kPushM) << y;
  const double oedometric = t.youngs_modulus_pa * .7 / (1.3 * .4) * kPushM / .006 * .12 * .12;
  EXPECT_NEAR(state.force_n / oedometric, 1, .03) << "its free sides are softer";
  EXPECT_LT(state.force_n, oedometric);
}

// Without Poisson's effect nothing moves along z, so a cylinder in it is the plane patient's disc.
TEST(SolidPress, CylinderWithoutPoissonIsThePlanePatient) {
  Tissue t;
  t.width_m = .06, t.depth_m = .025, t.poisson_ratio = 0;
  t.inclusions = {{.028, .012, .01, 5}};
  t.probe.width_m = .03, t.probe.elevation_m = .01;
  const ProbeState plane = Patient(t).press(.015, kPushM);
  t.solid.emplace();
  t.solid->elevational_width_m = .01;
  const ProbeState solid = press_solid(t, .015, kPushM, .001);
  EXPECT_NEAR(solid.force_n / plane.force_n, 1, .01);
  for (const double x : {.02, .028, .04})
    for (const double y : {.004, .012, .02}) {
      EXPECT_NEAR(solid.field->at(x, y).y, plane.field->at(x, y).y, .01 * kPushM) << x << " " << y;
      EXPECT_NEAR(solid.field->at(x, y).x, plane.field->at(x, y).x, .01 * kPushM) << x << " " << y;
      EXPECT_NEAR(solid.field->at(x, y, .003).z, 0, 1e-3 * kPushM);
    }
}

// Gazetas 1991 (Foundation Engineering Handbook, ch. 15): a rigid rectangle of half sides L and B on a
// half-space is K = 2 G L / (1 - nu) (0.73 + 1.54 (B / L)^0.75) stiff. A bottom takes off what a half-space
// moves there, P (1 + nu) (3 - 2 nu) / (2 pi E depth) (Boussinesq).
TEST(SolidPress, OnDeepTissueIsTheFootingOfSoilMechanics) {
  Tissue t = block(.32, .16, .32);
  t.poisson_ratio = .3;
  const ProbeState state = press(t, .0035);
  const double shear = t.youngs_modulus_pa / (2 * 1.3);
  const double stiffness = 2 * shear * .03 / .7 * (.73 + 1.54 * std::pow(1.0 / 6, .75));
  const double below = 1.3 * 2.4 / (2 * std::numbers::pi * t.youngs_modulus_pa * t.depth_m);
  EXPECT_NEAR(state.force_n / kPushM * (1 / stiffness - below), 1, .05);
}

TEST(SolidPress, ConvergesUnderRefinement) {
  const Tissue t = block(.08, .03, .04);
  double force[3], middle[3];
  const double spacing[3] = {.004, .0024, .0017};
  for (int k = 0; k < 3; ++k) {
    const ProbeState state = press(t, spacing[k]);
    force[k] = state.force_n, middle[k] = state.field->at(t.width_m / 2, .01).y / kPushM;
  }
  EXPECT_LE(std::abs(force[1] - force[2]), .5 * std::abs(force[0] - force[2]))
      << force[0] << " " << force[1] << " " << force[2];
  EXPECT_NEAR(force[1] / force[2], 1, .01);
  EXPECT_NEAR(middle[1], middle[2], .005) << middle[0];
}

// The probe beside z = 0 feels what it feels at 0 of tissue that was moved: its ends are far away.
TEST(SolidPress, AcrossThePlaneIsTheSameTissueMoved) {
  Tissue t = block(.08, .03, .1);
  t.inclusions = {{.045, .012, .01, 4, true, .009}};
  const ProbeState there = press_solid(t, middle_window(t), kPushM, .003, .01);
  EXPECT_EQ(there.window_z_m, .01);
  t.inclusions[0].z_m = -.001;
  const ProbeState here = press(t, .003);
  EXPECT_NEAR(there.force_n / here.force_n, 1, .006);
  for (const double x : {.02, .04, .055})
    for (const double z : {-.004, 0., .004})
      EXPECT_NEAR(there.field->at(x, .012, .01 + z).y, here.field->at(x, .012, z).y, .01 * kPushM)
          << x << " " << z;
  EXPECT_GT(std::abs(there.field->at(.04, .012, .01).y - there.field->at(.04, .012, 0).y), .05 * kPushM);
}

// What is pressed in above is carried through every row of elements: their mean vertical stress times area.
TEST(SolidPress, ForceIsCarriedDownToTheBottom) {
  Tissue t = block(.08, .03, .04);
  t.inclusions = {{.045, .012, .01, 4, true, .002}};
  t.solid->friction = std::numeric_limits<double>::infinity();
  const ProbeState state = press(t, .0025);
  const SolidMesh m = make_solid_mesh(t, middle_window(t), .0025);
  ASSERT_FALSE(m.half);
  const double nu = t.poisson_ratio;
  for (const std::size_t j : {std::size_t{0}, std::size_t{5}, m.ny() - 2}) {
    double force = 0;
    for (std::size_t k = 0; k + 1 < m.nz(); ++k)
      for (std::size_t i = 0; i + 1 < m.nx(); ++i) {
        const double dx = m.x_m[i + 1] - m.x_m[i], dy = m.y_m[j + 1] - m.y_m[j], dz = m.z_m[k + 1] - m.z_m[k];
        const double x = m.x_m[i] + dx / 2, y = m.y_m[j] + dy / 2, z = m.z_m[k] + dz / 2;
        const auto u = [&](double a, double b, double c) {
          return state.field->at(x + a * dx * .49, y + b * dy * .49, z + c * dz * .49);
        };
        const double xx = (u(1, 0, 0).x - u(-1, 0, 0).x) / (.98 * dx),
                     yy = (u(0, 1, 0).y - u(0, -1, 0).y) / (.98 * dy),
                     zz = (u(0, 0, 1).z - u(0, 0, -1).z) / (.98 * dz);
        force -= m.youngs_modulus_pa[m.element(i, j, k)] / (1 + nu) *
                 (yy + nu / (1 - 2 * nu) * (xx + yy + zz)) * dx * dz;
      }
    EXPECT_NEAR(force / state.force_n, 1, 1e-3) << "row " << j;
  }
}

TEST(SolidPress, IsLinearAndMovesTheFaceAsTold) {
  Tissue t = block(.1, .03, .04);
  t.inclusions = {{.045, .012, .01, 4}};
  t.solid->uneven = .1;
  const ProbeState state = press(t, .003);
  EXPECT_NEAR(press_solid(t, middle_window(t), 1e-4, .003).force_n * 4 / state.force_n, 1, 1e-4);
  for (const double x : {.02, .035, .05, .08})
    for (const double z : {0.0, .005, -.005}) {
      EXPECT_NEAR(state.field->at(x, 0, z).y, kPushM * (1 + .1 * (x - .05) / .03), 1e-10);
      EXPECT_NEAR(state.motion(x, 0).y, kPushM * (1 + .1 * (x - .05) / .03), 1e-12);
    }
  for (const double x : {.02, .08}) EXPECT_EQ(state.field->at(x, .03).y, 0);
  EXPECT_LT(state.field->at(.05, 0, .015).y, .6 * kPushM) << "free beside the face";
}

TEST(SolidPress, MirroredTissueMovesMirrored) {
  Tissue t = block(.1, .03, .04);
  t.inclusions = {{.04, .012, .01, 5}};
  const ProbeState left = press(t, .003);
  t.inclusions[0].x_m = .06;
  const ProbeState right = press(t, .003);
  EXPECT_NEAR(left.force_n / right.force_n, 1, 1e-4);
  EXPECT_NEAR(left.field->at(.045, .01).y, right.field->at(.055, .01).y, 1e-3 * kPushM);
  EXPECT_NEAR(left.field->at(.045, .01).x, -right.field->at(.055, .01).x, 1e-3 * kPushM);
  t.inclusions[0].sphere = true;
  const ProbeState half = press(t, .003);
  t.inclusions[0].z_m = 1e-12;  // no longer symmetric, as far as it knows
  const ProbeState whole = press(t, .003);
  EXPECT_NEAR(half.force_n / whole.force_n, 1, 3e-4);
  EXPECT_NEAR(half.field->at(.055, .012, -.003).z, whole.field->at(.055, .012, -.003).z, 1e-3 * kPushM);
  EXPECT_LT(half.force_n, right.force_n) << "a sphere is less than a cylinder";
}

// On tissue as wide as the probe what the face holds cannot bulge.
TEST(SolidPress, FrictionMattersWhereTissueIsAsWideAsTheProbe) {
  const auto force = [](Tissue t, double friction) {
    t.solid->friction = friction;
    return press(t, .003).force_n;
  };
  constexpr double kHeld = std::numeric_limits<double>::infinity();
  const Tissue wide = block(.12, .04, .08), narrow = block(.06, .04, .01);
  EXPECT_NEAR(force(wide, kHeld) / force(wide, 0), 1, .005);
  const double slides = force(narrow, 0), rubs = force(narrow, .1), holds = force(narrow, kHeld);
  EXPECT_GT(holds / slides, 1.03);
  EXPECT_GT(rubs, slides * 1.002);
  EXPECT_LT(rubs, holds * .999);
  EXPECT_NEAR(force(narrow, 100) / holds, 1, .01);
}

TEST(SolidPress, SofterSupportsAreSofter) {
  const auto force = [](Support support) {
    Tissue t = block(.1, .03, .06);
    t.solid->support = support;
    return press(t, .003).force_n;
  };
  const double bonded = force(Support::kBonded), sliding = force(Support::kSliding),
               bed = force(Support::kBed);
  EXPECT_LT(sliding, .995 * bonded);
  EXPECT_LT(bed, sliding);
}

TEST(SolidPress, ALeaningFaceTouchesInPart) {
  Tissue t = block(.1, .03, .04);
  const double whole = press(t, .003).force_n;
  t.solid->lean_m = .0005;  // of 1.5 mm
  EXPECT_NEAR(press(t, .003).force_n / whole, 1, 1e-4);
  t.solid->lean_m = .003;
  const ProbeState part = press(t, .003);
  EXPECT_LT(part.force_n, .9 * whole);
  EXPECT_GT(part.force_n, .5 * whole);
  EXPECT_LT(part.field->at(.022, 0).y, .9 * kPushM);
  EXPECT_NEAR(part.field->at(.078, 0).y, kPushM, 1e-10);
}

TEST(SolidPress, RefusesWhatItCannotPress) {
  Tissue t = block(.1, .03, .04);
  EXPECT_THROW(press_solid(t, .05, kPushM), std::invalid_argument);
  EXPECT_THROW(press_solid(t, 0, .01), std::invalid_argument);
  const double beyond_m = (t.solid->elevational_width_m - t.probe.elevation_m) / 2 + 1e-3;
  EXPECT_THROW(press_solid(t, 0, kPushM, kSolidSpacing, beyond_m), std::invalid_argument);
  EXPECT_THROW(press_solid(t, 0, kPushM, kSolidSpacing, -beyond_m), std::invalid_argument);
  EXPECT_THROW(Patient{t}, TissueError);
  t.solid->friction = -1;
  EXPECT_THROW(press_solid(t, 0, kPushM), TissueError);
  t.solid.reset();
  EXPECT_THROW(press_solid(t, 0, kPushM), TissueError);
}

TEST(TrueModulus, ChangesWithDepthAsStatedAndLumpsWithIt) {
  Tissue t = block(.2, .1, .2);
  t.inclusions = {{.1, .05, .01, 5, true}};
  t.solid->capsule_m = .002, t.solid->capsule_contrast = 3;
  t.solid->bottom_contrast = .25;
  const TrueModulus graded(t);
  EXPECT_EQ(graded(.02, 0), 30e3);
  EXPECT_DOUBLE_EQ(graded(.02, .05), 5e3);
  EXPECT_DOUBLE_EQ(graded(.02, .1), 2.5e3);
  EXPECT_DOUBLE_EQ(graded(.1, .05), 25e3);
}

TEST(TrueModulus, HasTheStatedTextureOverLumpsAndCapsule) {
  Tissue t = block(.2, .1, .2);
  t.inclusions = {{.1, .05, .01, 5, true}};
  t.solid->capsule_m = .002, t.solid->capsule_contrast = 3;
  EXPECT_EQ(TrueModulus(t)(.1, .001), 30e3);
  EXPECT_EQ(TrueModulus(t)(.1, .0021), 10e3);
  EXPECT_EQ(TrueModulus(t)(.1, .05), 50e3);
  EXPECT_EQ(TrueModulus(t)(.1, .05, .0051), 10e3) << "a sphere ends";
  t.solid->texture = .2;
  const TrueModulus textured(t);
  std::vector<double> here, beside;
  for (double x = .001; x < .2; x += .0043)
    for (double y = .004; y < .1; y += .0047)
      for (double z = -.1; z < .1; z += .021) {
        const double smooth = t.true_modulus(x, y, z);
        here.push_back(std::log(textured(x, y, z) / smooth));
        beside.push_back(std::log(textured.texture(x, y, z + .004)));
      }
  const auto n = static_cast<double>(here.size());
  double sum = 0, squares = 0, product = 0;
  for (std::size_t i = 0; i < here.size(); ++i)
    sum += here[i], squares += here[i] * here[i], product += here[i] * beside[i];
  EXPECT_NEAR(sum / n, 0, .02);
  EXPECT_NEAR(std::sqrt(squares / n), .2, .02);
  EXPECT_NEAR(product / squares, std::exp(-.5), .08);
  t.seed = 2;
  EXPECT_NE(TrueModulus(t)(.1, .05), textured(.1, .05));
}

}  // namespace
}  // namespace teletact::client
