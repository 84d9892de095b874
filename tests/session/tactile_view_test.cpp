// Tactile images at a terminal.
#include "client/session/tactile_view.h"

#include <gtest/gtest.h>

namespace teletact::client {
namespace {

TactileImage image() {
  TactileImage out;
  out.along_x = 3, out.along_z = 2, out.pitch_m = 0.002;
  out.begin_x_m = 0.048, out.begin_z_m = -0.011;
  out.pressure_pa = {0, 500, 1000, 2000, 1500, 0};
  out.force_n = 0.2;
  return out;
}

TEST(TactileView, IsDarkestWhereThePressureIsLargest) {
  EXPECT_EQ(tactile_view(image()),
            "0.200 N at x 50.0 mm, z -10.0 mm; full scale 2.00 kPa\n"
            "│  ░░▒▒│\n"
            "│██▓▓  │\n");
}

TEST(TactileView, ShowsBesideItWhereThereIsMoreAndLess) {
  TactileImage with = image();
  with.beyond_pa = {-200, -100, 0, 400, 0, 0};
  EXPECT_EQ(
      tactile_view(with),
      "0.200 N at x 50.0 mm, z -10.0 mm; full scale 2.00 kPa, and 0.40 kPa beyond homogeneous tissue on the "
      "right\n"
      "│  ░░▒▒│  │····  │\n"
      "│██▓▓  │  │██    │\n");
  with.beyond_pa[0] = -400;
  EXPECT_NE(tactile_view(with).find("│--··  │"), std::string::npos) << tactile_view(with);
}

TEST(TactileView, IsBlankWithoutPressure) {
  TactileImage none = image();
  none.pressure_pa.assign(6, 0);
  EXPECT_NE(tactile_view(none).find("│      │"), std::string::npos);
}

TEST(TactileScreen, StaysInOnePlaceOfATerminalAndGoesDownAFile) {
  TactileScreen terminal(true), file(false);
  const std::string first = terminal.frame(image());
  EXPECT_EQ(first.find("\033[3A"), std::string::npos) << "nothing is above it yet";
  EXPECT_EQ(terminal.frame(image()), "\033[3A" + first);
  EXPECT_NE(first.find("│\033[K\n"), std::string::npos) << "what an older line leaves is cleared";
  EXPECT_EQ(file.frame(image()), tactile_view(image()));
  EXPECT_EQ(file.frame(image()), tactile_view(image()));
}

}  // namespace
}  // namespace teletact::client
