// A solid through scene and session: given, touched, kept on disk.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <thread>
#include <vector>

#include "service/contact/solid_answer.h"
#include "service/scene/scene_record.h"
#include "service/scene/tissue_models.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/solid_with_ball.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {
namespace {

// By the nodes: shares, once they are learned, state no pressure. On a busy machine a correction may come
// late.
TEST(SolidScene, IsTouchedInThreeDimensions) {
  const auto scene = scene_of(with_ball());
  TouchSession session(scene, {.fingertip = {}, .path = SolvePath::kGradients}, test_device());
  const auto corrected = [&session](double z_m) {
    TouchAnswer answer = touched(session, kBallX, 0.002, z_m);
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (answer.status != TouchStatus::kOk && std::chrono::steady_clock::now() < until) {
      const bool late = answer.status == TouchStatus::kDegraded &&
                        answer.contact.solve.relative_error > choices::kSolidForceError,
                 none = answer.status == TouchStatus::kFailed && answer.contact.force_n == Vector3{};
      EXPECT_TRUE((late || none) && !answer.warning.empty()) << answer.contact.solve.relative_error;
      answer = touched(session, kBallX, 0.002, z_m);
    }
    return answer;
  };
  const TouchAnswer over = corrected(kBallZ);
  ASSERT_EQ(over.status, TouchStatus::kOk) << over.warning;
  EXPECT_LE(over.contact.solve.relative_error, choices::kSolidForceError);
  const TouchAnswer beside = corrected(kBallZ - 0.012);
  ASSERT_EQ(beside.status, TouchStatus::kOk) << beside.warning;
  EXPECT_GT(over.contact.force_n[1] / beside.contact.force_n[1], 1.1) << "the ball is felt along z";
  const TouchAnswer before = corrected(kBallZ - 0.004);
  ASSERT_EQ(before.status, TouchStatus::kOk) << before.warning;
  EXPECT_GT(std::abs(before.contact.force_n[2]), 0.01 * std::abs(before.contact.force_n[1]));
  EXPECT_LT(before.contact.force_n[2], 0) << "the ball, at larger z, pushes away";
  EXPECT_NE(before.contact.tangent_n_m[8], 0);
  ASSERT_FALSE(before.contact.pressure.empty());
  double z = 0, p = 0;
  for (const NodalPressure& n : before.contact.pressure)
    z += n.position_m[2] * n.pressure_pa, p += n.pressure_pa;
  EXPECT_NEAR(z / p, kBallZ - 0.004, 0.001) << "in the scene's coordinates";
}

// Corrections are made beside: a finger that moves is answered without them, and says what it is off by; one
// that rests is soon off by no more than is asked.
TEST(SolidScene, FollowsAMovingFingerAndConvergesAtRest) {
  const auto scene = scene_of(with_ball());
  TouchSession session(scene, {}, test_device()), exact(scene_of(with_ball()), {}, test_device());
  const auto settled = [](TouchSession& finger, double x_m) {
    TouchAnswer a = touched(finger, x_m, 0.002, kBallZ);
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!a.contact.solve.converged && std::chrono::steady_clock::now() < until) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      a = touched(finger, x_m, 0.002, kBallZ);
    }
    return a;
  };
  EXPECT_EQ(touched(session, 0.012, 0.002, kBallZ).status, TouchStatus::kOk) << "it waited for a correction";
  struct Felt {
    double x_m;
    TouchAnswer answer;
  };
  std::vector<Felt> felt;
  for (int k = 0; k < 120; ++k) {
    felt.push_back({0.012 + 0.0002 * k, touched(session, 0.012 + 0.0002 * k, 0.002, kBallZ)});
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  const TouchAnswer rests = settled(session, felt.back().x_m);
  EXPECT_TRUE(rests.contact.solve.converged) << rests.contact.solve.relative_error;
  EXPECT_EQ(rests.status, TouchStatus::kOk) << rests.warning;
  int covered = 0, judged = 0;
  for (std::size_t k = 0; k < felt.size(); k += 10) {
    const auto& solve = felt[k].answer.contact.solve;
    const TouchAnswer truth = settled(exact, felt[k].x_m);
    ASSERT_TRUE(truth.contact.solve.converged);
    const double force = truth.contact.force_n[1], stated = solve.relative_error;
    covered += std::abs(felt[k].answer.contact.force_n[1] - force) <=
               (stated + truth.contact.solve.relative_error) * std::abs(force);
    ++judged;
    const bool trusted = solve.converged || (solve.improving && stated <= choices::kTrustedMeanwhile);
    EXPECT_EQ(felt[k].answer.status, trusted ? TouchStatus::kOk : TouchStatus::kDegraded) << stated;
  }
  EXPECT_GE(covered, judged - 1);
}

// What is known of the tissue is replaced, and the surface goes, while it is being corrected.
TEST(SolidScene, EndsWhileItIsCorrected) {
  for (int k = 0; k < 3; ++k) {
    const auto scene = scene_of(with_ball());
    TouchSession session(scene, {}, test_device());
    touched(session, 0.014, 0.002, kBallZ);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    for (int n = 0; n < 5; ++n)
      EXPECT_EQ(touched(session, 0.016 + 0.0004 * n, 0.002, kBallZ).contact.state, ContactState::kContact);
  }
}

TEST(SolidScene, TwoFingersAtOnceEachFeelTheirOwn) {
  const TouchOptions by_nodes{.fingertip = {}, .path = SolvePath::kGradients};
  const auto scene = scene_of(with_ball());
  const auto sweep = [&](TouchSession& session, double z_m) {
    std::vector<ContactAnswer> answers;
    for (int k = 0; k < 12; ++k) {
      TouchAnswer a = touched(session, 0.018 + 0.001 * k, 0.002, z_m);
      for (int tries = 0; tries < 200 && a.status != TouchStatus::kOk;
           ++tries) {  // as long as the other's last
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        a = touched(session, 0.018 + 0.001 * k, 0.002, z_m);
      }
      EXPECT_EQ(a.status, TouchStatus::kOk) << a.warning;
      answers.push_back(a.contact);
    }
    return answers;
  };
  std::array<std::vector<ContactAnswer>, 2> alone, together;
  const auto place_of = [](std::size_t n) { return n == 0 ? kBallZ : kBallZ - 0.010; };
  for (std::size_t n = 0; n < 2; ++n) {
    TouchSession session(scene_of(with_ball()), by_nodes, test_device());
    alone[n] = sweep(session, place_of(n));
  }
  TouchSession first(scene, by_nodes, test_device());  // whose touch makes it ready
  EXPECT_EQ(touched(first, 0.020, 0.001, 0.0).status, TouchStatus::kOk);
  std::vector<std::thread> fingers;
  for (std::size_t n = 0; n < 2; ++n)
    fingers.emplace_back([&, n] {
      TouchSession session(scene, by_nodes, test_device());
      together[n] = sweep(session, place_of(n));
    });
  for (std::thread& finger : fingers) finger.join();
  for (std::size_t n = 0; n < 2; ++n)
    for (std::size_t k = 0; k < alone[n].size(); ++k) {
      const ContactAnswer &a = alone[n][k], &b = together[n][k];
      EXPECT_LT(a.force_n[1], -0.05);
      for (std::size_t c = 0; c < 3; ++c)
        EXPECT_NEAR(a.force_n[c], b.force_n[c],
                    (a.solve.relative_error + b.solve.relative_error) * std::abs(a.force_n[1]))
            << "finger " << n << ", place " << k << ", component " << c << ": " << a.force_n[c]
            << " N, stated " << a.solve.relative_error << " and " << b.solve.relative_error;
    }
}

TEST(SolidScene, EndsWhereItsModulusDoes) {
  const auto scene = scene_of(with_ball());
  const Region region = scene->snapshot()->windows.front()->region;
  EXPECT_DOUBLE_EQ(region.z->begin_m, -0.018);
  EXPECT_NEAR(region.z->end_m, 0.018, 1e-12);
  TouchSession session(scene, {}, test_device());
  const TouchAnswer beside = touched(session, 0.02, 0.001, 0.019);
  EXPECT_EQ(beside.status, TouchStatus::kNotCovered);
  EXPECT_NE(beside.warning.find("beside the tissue"), std::string::npos) << beside.warning;
  EXPECT_DOUBLE_EQ(touched(session, 0.02, 0.001, 0.0).covered.z->begin_m, -0.018);
  EXPECT_EQ(beside.contact.force_n, (Vector3{}));
  EXPECT_EQ(touched(session, 0.02, 0.001, 0.017).status, TouchStatus::kOk) << "others go on";
}

TEST(SolidScene, BlockKeepsWhatIsGivenAndGoesOnAroundIt) {
  const ExplicitModulus e = with_ball();
  const SolidBlock block = solid_block(tissue(kWidthM, kDepthM), e);
  const SolidGrid& grid = block.tissue.grid;
  EXPECT_EQ(grid.nx, 32u);  // 24 and 16 mm
  EXPECT_EQ(grid.nz, 64u);  // 12 slices in two parts, and 16 mm
  EXPECT_DOUBLE_EQ(grid.spacing_z_m, 0.0015);
  const auto at = [&](std::size_t i, std::size_t j, std::size_t k) {
    return block.tissue.youngs_modulus_pa[i + grid.nx * (k + grid.nz * j)];
  };
  // Between the middles of two slices ln E is interpolated: a quarter of the way at a part's own middle.
  const auto given = [&](std::size_t i, std::size_t j, std::size_t k) {
    return e.youngs_modulus_pa[i + 24 * (j + 10 * k)];
  };
  for (std::size_t k = 1; k < 11; ++k)
    EXPECT_NEAR(at(12, 3, 2 * k), std::pow(given(12, 3, k), 0.75) * std::pow(given(12, 3, k - 1), 0.25),
                1e-6 * 8e4);
  EXPECT_EQ(at(25, 3, 10), at(23, 3, 10));
  EXPECT_EQ(at(31, 3, 10), at(0, 3, 10));
}

TEST(SolidScene, RefusesWhatNoBlockIs) {
  const auto refused = [](const ExplicitModulus& e, SceneGeometry g, const char* field) {
    try {
      solid_block(g, e);
      ADD_FAILURE() << field << " was taken";
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).rfind(field, 0), 0u) << error.what();
    }
  };
  const SceneGeometry good = tissue(kWidthM, kDepthM);
  ExplicitModulus e = with_ball();
  e.x_m[3] += 0.0005;
  refused(e, good, "modulus.x_m");
  e = with_ball();
  e.z_m[3] += 0.0005;
  refused(e, good, "modulus.z_m");
  SceneGeometry held = good;
  held.supports.left = EdgeSupport::kFixed;
  refused(with_ball(), held, "geometry.supports");
  TouchOptions by_compliance;
  by_compliance.path = SolvePath::kCompliance;
  TouchSession condensed(scene_of(with_ball()), by_compliance, test_device());
  EXPECT_EQ(condensed.solve({0.02, 0.001, 0}).status, TouchStatus::kFailed);
  TouchSession without(scene_of(with_ball()), {}, nullptr);
  const TouchAnswer none = without.solve({0.02, 0.001, 0});
  EXPECT_EQ(none.status, TouchStatus::kFailed);
  EXPECT_TRUE(none.device_failed) << none.warning;
}

// Few values may ask for much: what is around them, and how wide the tissue is, is bounded before it is made.
TEST(SolidScene, RefusesSmallRequestsForLargeBlocks) {
  const auto even = [](std::size_t nodes, double end_m) {
    std::vector<double> out;
    for (std::size_t n = 0; n < nodes; ++n) out.push_back(end_m * double(n) / double(nodes - 1));
    return out;
  };
  const auto refused = [&](const std::vector<double>& x, const std::vector<double>& y,
                           const std::vector<double>& z, const char* field) {
    ExplicitModulus e{x, y, std::vector<double>((x.size() - 1) * (y.size() - 1) * (z.size() - 1), 1e4)};
    e.z_m = z;
    try {
      solid_block(tissue(x.back(), y.back()), e);
      ADD_FAILURE() << field << " was taken";
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).rfind(field, 0), 0u) << error.what();
    }
  };
  refused(even(30, 0.002), even(13794, 0.3), {0, 6.1e-5}, "modulus: 512 x");
  refused(even(57, 0.002), {0, 0.3}, {0, 3.2e-5}, "modulus.x_m: ");
  refused(even(57, 0.05), {0, 0.3}, {0, 9.223372036854775e15, 1.8446744073709550e16}, "modulus.z_m: reaches");
}

TEST(SolidScene, RefusesWideTipsAndSaysTooCoarseAMesh) {
  TouchOptions wide;
  wide.fingertip = {.shape = FingertipShape::kFlatPunch,
                    .friction = Friction::kFrictionless,
                    .radius_m = 0.014,
                    .half_width_m = 0.014};
  TouchSession session(scene_of(with_ball()), wide, test_device());
  EXPECT_EQ(touched(session, 0.001, 0.008, 0).status, TouchStatus::kFailed)
      << "it would press the other end's tissue";
  TouchOptions sharp;
  sharp.path = SolvePath::kGradients;  // others have no mesh
  sharp.fingertip.radius_m = 0.002;
  TouchSession coarse(scene_of(with_ball()), sharp, test_device());
  const TouchAnswer answer = touched(coarse, 0.02, 0.0006, 0);
  EXPECT_NE(answer.warning.find("too coarse"), std::string::npos) << answer.warning;
}

// Over a hard ball the mesh of 2 mm is felt the more, the lighter the touch.
TEST(SolidScene, AnswersSayWhenTheyMissTheTolerance) {
  TouchOptions options;
  options.tolerance = Tolerance{0.12, 0};
  TouchSession session(scene_of(with_ball()), options, test_device());
  const TouchAnswer deep = touched(session, kBallX, 0.002, kBallZ),
                    light = touched(session, kBallX, 0.0005, kBallZ);
  EXPECT_EQ(deep.status, TouchStatus::kOk) << deep.warning;
  EXPECT_EQ(deep.contact.budget.relative(ErrorTerm::kSolver), deep.contact.solve.relative_error);
  EXPECT_LT(deep.contact.budget.half_width(), 0.12);
  EXPECT_GT(light.contact.budget.half_width(), 0.12);
  EXPECT_GT(light.contact.budget.relative(ErrorTerm::kMesh), deep.contact.budget.relative(ErrorTerm::kMesh));
  EXPECT_EQ(light.status, TouchStatus::kDegraded);
  EXPECT_NE(light.warning.find("more than was asked for"), std::string::npos) << light.warning;
  options.tolerance->force_n = 1;
  TouchSession patient(scene_of(with_ball()), options, test_device());
  EXPECT_EQ(touched(patient, kBallX, 0.0005, kBallZ).status, TouchStatus::kOk);
}

// By finite elements, axisymmetric, of the sphere's own shape and at large strain: a rigid sphere on
// neo-Hookean tissue (nu 0.49 and 0.499, 5 R deep), and on tissue whose tangent modulus doubles at 20 % of
// strain (2.5 R deep).
TEST(SolidScene, AnswersStateWhatLinearTissueLeavesOut) {
  struct Computed {
    double strain, softer, softest, stiffer;  // d / R; 1 - F / F_linear by nu; F / F_linear - 1
  };
  const Fingertip tip{.shape = FingertipShape::kSphere, .radius_m = 0.004};
  for (const auto& [strain, softer, softest, stiffer] :
       {Computed{0.05, 0.0125, 0.0149, 0}, {0.25, 0.0297, 0.0364, 0.0711}, {0.5, 0.0451, 0.0551, 0.2565}}) {
    ForceBudget budget;
    budget.add(finite_strain(tip, strain * tip.radius_m));
    EXPECT_GT(budget.half_width(), softer) << strain;
    EXPECT_NEAR(budget.half_width(), softest, 5e-4) << strain;
    const double above = stiffening(tip, strain * tip.radius_m);
    EXPECT_GT(above, stiffer) << strain;
    EXPECT_LT(above, stiffer + 0.032) << strain;
  }
}

TEST(SolidScene, TissueThatIsStatedToBeLinearDoesNotStiffen) {
  for (const bool linear : {false, true}) {
    SceneGeometry geometry = tissue(kWidthM, kDepthM);
    geometry.linear = linear;
    TouchSession session(std::make_shared<Scene>("s", geometry, with_ball(), versions()), {}, test_device());
    const ForceBudget budget = touched(session, kBallX, 0.002, kBallZ).contact.budget;
    ASSERT_FALSE(budget.terms().empty());
    EXPECT_EQ(budget.above > 0, !linear);
  }
}

TEST(SolidScene, APadIsForSolidsAlone) {
  TouchOptions pad;
  pad.fingertip = {.shape = FingertipShape::kPad,
                   .friction = Friction::kFrictionless,
                   .radius_m = 0.001,
                   .half_width_m = 0.008,
                   .pad_m_pa = 1e-7};
  TouchSession session(scene_of(with_ball()), pad, test_device());
  const TouchAnswer answer = touched(session, kBallX, 0.002, kBallZ);
  EXPECT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
  EXPECT_LT(answer.contact.force_n[1], 0);
  const auto plane = std::make_shared<Scene>("p", tissue(0.06, 0.04), versions());
  try {
    TouchSession(plane, pad, test_device());
    FAIL() << "a plane scene took a pad";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("open.fingertip.shape: a pad"), std::string::npos);
  }
}

TEST(SolidScene, ANodeTouchesIt) {
  for (const double footprint_m : {0.0, 0.0015}) {
    TouchOptions node;
    node.fingertip = {.shape = FingertipShape::kNode, .footprint_m = footprint_m};
    TouchSession session(scene_of(with_ball()), node, test_device());
    const TouchAnswer over = touched(session, kBallX, 0.001, kBallZ);
    ASSERT_EQ(over.status, TouchStatus::kOk) << over.warning;
    EXPECT_LE(over.contact.solve.relative_error, choices::kSolidForceError);
    const TouchAnswer edge = touched(session, 0.002, 0.001, 0.017);  // as far between nodes
    ASSERT_EQ(edge.status, TouchStatus::kOk) << edge.warning;
    EXPECT_GT(over.contact.force_n[1] / edge.contact.force_n[1], 1.02) << "the ball is felt";
  }
}

// Float leaves more than is asked: the answer says so, and is not refused.
TEST(SolidScene, NearlyIncompressibleTissueIsDegraded) {
  SceneGeometry g = tissue(kWidthM, kDepthM);
  g.poisson_ratio = 0.4999;
  const auto scene =
      std::make_shared<Scene>("s", g, with_ball(), versions(), Limits{}, MemoryAccount{}, tissue_models());
  TouchSession session(scene, {}, test_device());
  const TouchAnswer answer = touched(session, kBallX, 0.002, kBallZ);
  EXPECT_EQ(answer.status, TouchStatus::kDegraded) << answer.warning;
  EXPECT_LT(answer.contact.force_n[1], -0.05);
  EXPECT_GT(answer.contact.solve.relative_error, choices::kSolidForceError);
}

TEST(SolidScene, IsTheSameAfterARestart) {
  SceneRecord record;
  record.id = "s";
  record.geometry = tissue(kWidthM, kDepthM);
  record.version = 3;
  record.explicit_modulus = with_ball();
  const EncodedScene encoded_scene = encoded(record);
  const SceneRecord again = decoded(
      encoded_scene.description, [&](const std::string&) { return encoded_scene.map; }, Limits{});
  ASSERT_TRUE(again.explicit_modulus && again.explicit_modulus->solid());
  EXPECT_EQ(again.explicit_modulus->z_m, record.explicit_modulus->z_m);
  EXPECT_EQ(again.explicit_modulus->youngs_modulus_pa, record.explicit_modulus->youngs_modulus_pa);
  record.windows.push_back({1, 3, 0, kWidthM, nullptr});
  const Scene restored(record, versions(), Limits{}, MemoryAccount{}, tissue_models());
  EXPECT_DOUBLE_EQ(restored.snapshot()->windows.front()->region.z->begin_m, -0.018);
}

}  // namespace
}  // namespace teletact::service
