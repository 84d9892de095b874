#include "service/solver/level_layout.h"

#include <gtest/gtest.h>

namespace teletact::service {
namespace {

std::vector<double> even(std::size_t count, double step) {
  std::vector<double> lines;
  for (std::size_t i = 0; i < count; ++i) lines.push_back(step * static_cast<double>(i));
  return lines;
}

TEST(NodeLines, InterpolationReproducesStraightLinesAtAnySpacing) {
  for (const auto& fine :
       {even(2, 1), even(3, 1), even(8, 0.1), even(9, 1), std::vector<double>{0, 1, 3, 4, 4.5, 9, 9.2, 11}}) {
    const LineTransfer t = coarsen(fine, 3);
    EXPECT_EQ(t.coarse.front(), fine.front());
    EXPECT_EQ(t.coarse.back(), fine.back());
    for (std::size_t i = 0; i < fine.size(); ++i) {
      const auto c = static_cast<std::size_t>(t.left[i]);
      const double right = c + 1 < t.coarse.size() ? t.coarse[c + 1] : 0;
      EXPECT_NEAR((1 - t.weight[i]) * t.coarse[c] + t.weight[i] * right, fine[i], 1e-14);
    }
  }
}

TEST(NodeLines, RestrictionWeightsAreTheInterpolationWeights) {
  const LineTransfer t = coarsen({0, 1, 3, 4, 4.5, 5, 9.2, 11}, 3);
  for (std::size_t c = 0; c < t.coarse.size(); ++c)
    for (int side = 0; side < 2; ++side) {
      const int line = t.at[c] + 2 * side - 1;
      if (line < 0 || line >= static_cast<int>(t.left.size())) continue;
      const auto i = static_cast<std::size_t>(line);
      const double weight = t.left[i] == static_cast<int>(c)       ? 1 - t.weight[i]
                            : t.left[i] + 1 == static_cast<int>(c) ? t.weight[i]
                                                                   : 0;
      EXPECT_EQ(t.around[2 * c + static_cast<std::size_t>(side)], weight) << c << " " << side;
    }
}

TEST(NodeLines, EveryLevelAtLeastHalvesAnEvenGrid) {
  for (const std::size_t count : {5u, 6u, 61u, 80u}) {
    double spacing = 0.5;
    const GridTransfer t = coarsen(NodeLines{even(count, 0.5), even(count, 0.5)}, spacing);
    EXPECT_LE(t.x.coarse.size(), count / 2 + 1);
    EXPECT_LE(t.y.coarse.size(), count / 2 + 1);
  }
}

TEST(NodeLines, StretchedElementsAreCoarsenedAcrossTheirShortSide) {
  const NodeLines stretched{even(9, 10), even(33, 1)};
  double spacing = smallest_spacing(stretched);
  EXPECT_EQ(spacing, 1);
  const GridTransfer t = coarsen(stretched, spacing);
  EXPECT_EQ(t.x.coarse.size(), 9u);
  EXPECT_EQ(t.y.coarse.size(), 17u);
}

TEST(NodeLines, ShortSideIsToldWhereElementsAreStretchedOneWay) {
  const std::vector<double> even{0, 1, 2, 3}, wide{0, 5, 10}, graded{0, 1, 6};
  EXPECT_EQ(short_side({even, even}), ShortSide::kNeither);
  EXPECT_EQ(short_side({even, wide}), ShortSide::kX);
  EXPECT_EQ(short_side({graded, even}), ShortSide::kY);
  EXPECT_EQ(short_side({graded, graded}), ShortSide::kNeither);  // both ways
  const GridTransfer t = coarsen_fully({graded, even});
  EXPECT_EQ(t.x.coarse, (std::vector<double>{0, 6}));
  EXPECT_EQ(t.y.coarse, (std::vector<double>{0, 2, 3}));
}

}  // namespace
}  // namespace teletact::service
