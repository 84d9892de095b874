// The contact chart's problems are what they say they are, and every method on this machine gives the same
// force.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "bench/peers/peer.h"

namespace teletact::bench {
namespace {

constexpr Pattern kPatterns[] = {Pattern::kNodule, Pattern::kCheckerboard, Pattern::kSponge,
                                 Pattern::kLayered};

ContactCase small(Pattern pattern) {
  return {.columns = 25, .rows = 13, .contrast = 10, .pattern = pattern, .contact_nodes = 6};
}

TEST(ContactCase, HoldsItsContrastInEveryPatternAndSize) {
  for (const Pattern pattern : kPatterns)
    for (const auto& [columns, rows] : {std::pair{51, 8}, {51, 21}, {41, 41}, {121, 121}})
      for (const double contrast : {10.0, 1000.0}) {
        const auto tissue = make_tissue({.columns = static_cast<std::size_t>(columns),
                                         .rows = static_cast<std::size_t>(rows),
                                         .contrast = contrast,
                                         .pattern = pattern});
        const auto& moduli = tissue.material.youngs_modulus_pa;
        EXPECT_EQ(tissue.grid.nx(), static_cast<std::size_t>(columns));
        EXPECT_EQ(tissue.grid.ny(), static_cast<std::size_t>(rows));
        ASSERT_EQ(moduli.size(), tissue.grid.elements());
        EXPECT_EQ(std::set<double>(moduli.begin(), moduli.end()), (std::set<double>{10e3, 10e3 * contrast}))
            << to_string(pattern) << " " << columns << "x" << rows;
      }
}

TEST(ContactCase, PatternsLookAsTheirNamesSay) {
  const auto stiff = [](Pattern pattern, std::size_t i, std::size_t j) {
    const auto tissue = make_tissue({.pattern = pattern});
    return tissue.material.youngs_modulus_pa[tissue.grid.element(i, j)] > 10e3;
  };
  EXPECT_TRUE(stiff(Pattern::kNodule, 27, 24));
  EXPECT_FALSE(stiff(Pattern::kNodule, 55, 24));
  EXPECT_NE(stiff(Pattern::kCheckerboard, 2, 2), stiff(Pattern::kCheckerboard, 7, 2));
  EXPECT_EQ(stiff(Pattern::kCheckerboard, 2, 2), stiff(Pattern::kCheckerboard, 7, 7));
  EXPECT_FALSE(stiff(Pattern::kSponge, 5, 5));  // the middle of a pore
  EXPECT_TRUE(stiff(Pattern::kSponge, 0, 0));
  for (const std::size_t i : {0u, 31u, 59u}) {
    EXPECT_FALSE(stiff(Pattern::kLayered, i, 5));
    EXPECT_TRUE(stiff(Pattern::kLayered, i, 15));
  }
}

TEST(ContactCase, StretchedElementsAreStretched) {
  const auto tissue = make_tissue({.columns = 31, .rows = 11, .stretch = 5});
  EXPECT_NEAR(tissue.grid.y_m[1] / (tissue.grid.x_m[1] - tissue.grid.x_m[0]), 5, 1e-12);
}

TEST(ContactCase, TipTouchesAsManyNodesAsAsked) {
  for (const Pattern pattern : kPatterns) {
    const ContactProblem p = make_problem(small(pattern));
    EXPECT_EQ(p.truth.columns.size(), 6u);
    EXPECT_EQ(p.overlap_m.size(), 6);
    EXPECT_LT(p.truth.force_n[1], 0);
    EXPECT_LE(p.force_error(p.force_n(p.truth.multiplier_n_m)), 1e-14);
  }
  EXPECT_THROW(make_problem({.columns = 9, .rows = 5, .contact_nodes = 10}), std::invalid_argument);
}

TEST(Peers, AllGiveTheForceOfTheReference) {
  const Peers peers = make_peers(service::Device::open());
  EXPECT_GE(peers.all.size(), 6u);
  for (const std::string& absent : peers.absent) GTEST_LOG_(INFO) << "absent: " << absent;
  for (const Pattern pattern : {Pattern::kNodule, Pattern::kCheckerboard}) {
    const ContactProblem p = make_problem(small(pattern));
    for (const auto& peer : peers.all) {
      ASSERT_LE(p.tissue.grid.dofs(), peer->max_unknowns()) << peer->name();
      peer->prepare(p);
      const bool single = peer->name().find("float") != std::string::npos;
      const PeerAnswer answer = peer->touch(p, single ? 6e-4 : 1e-9);
      EXPECT_LE(p.force_error(answer.force_n), single ? 5e-3 : 1e-7) << peer->name();
      if (answer.displacement_m.size() > 0) {
        EXPECT_LE(p.displacement_error(answer.displacement_m), single ? 5e-3 : 1e-7) << peer->name();
      }
      EXPECT_EQ(answer.iterations > 0, peer->iterative()) << peer->name();
    }
  }
}

}  // namespace
}  // namespace teletact::bench
