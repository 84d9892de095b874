// What the product computes is what it computed when the vectors were recorded (docs/develop/testing.md).
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "tests/support/environment.h"
#include "tests/vectors/recorder/record.h"

namespace teletact::vectors {
namespace {

namespace fs = std::filesystem;

TEST(Vectors, AreThoseThatWereRecorded) {
  const Recording before = Recording::read(fs::path(test::required_environment("TELETACT_SOURCE_DIR")) /
                                           "tests/vectors/recorded.bin");
  std::size_t same = 0;
  const std::vector<Difference> differences = compare(record_all(), before);
  for (const Difference& d : differences) {
    EXPECT_TRUE(d.within) << to_string(d);
    same += d.same_bits;
  }
  std::printf("%zu of %zu vectors are the same to the bit\n", same, differences.size());
}

class Comparison : public testing::Test {
 protected:
  static Recording of(std::vector<double> values) {
    Recording recording;
    recording.append("v", 2, values, {1e-3, 0.25});
    return recording;
  }
  // `now` against what was written of `before`.
  Difference difference(const std::vector<double>& now, const std::vector<double>& before,
                        std::size_t rows = 100) {
    const fs::path file = fs::path(test::required_environment("TELETACT_BINARY_DIR")) / "compared.vectors";
    of(before).write(file, rows);
    const auto differences = compare(of(now), Recording::read(file));
    fs::remove(file);
    return differences.at(0);
  }
  const double nan = std::nan("");
  const std::vector<double> values{1, 2, nan, 4, 5, INFINITY, 7, 8};
};

TEST_F(Comparison, SameNumbersAreTheSameToTheBit) {
  EXPECT_TRUE(difference(values, values).same_bits);
  EXPECT_TRUE(difference(values, values, 2).same_bits);
}

TEST_F(Comparison, ASmallDifferenceIsToldAndWithin) {
  auto now = values;
  now[6] += 0.004;
  const Difference d = difference(now, values);
  EXPECT_FALSE(d.same_bits);
  EXPECT_NEAR(d.absolute, 0.004, 1e-12);
  EXPECT_NEAR(d.relative, 0.0005, 1e-12);
  EXPECT_TRUE(d.within);
}

TEST_F(Comparison, OnlySomeRowsMayDifferByMore) {
  auto now = values;
  now[0] = nan;
  EXPECT_TRUE(difference(now, values).within);
  EXPECT_EQ(difference(now, values).absolute, INFINITY);
  now[7] += 1;
  EXPECT_FALSE(difference(now, values).within);
}

TEST_F(Comparison, ARowThatIsNotHeldStillChangesTheBits) {
  auto now = values;
  now[2] = 3;
  const Difference d = difference(now, values, 2);
  EXPECT_FALSE(d.same_bits);
  EXPECT_EQ(d.absolute, 0);
}

TEST_F(Comparison, OtherShapesAndNamesAreNeverWithin) {
  EXPECT_FALSE(difference({1, 2}, values).within);
  Recording other;
  other.append("w", 1, values, {1, 1});
  for (const Difference& d : compare(other, of(values))) EXPECT_FALSE(d.within) << d.name;
}

}  // namespace
}  // namespace teletact::vectors
