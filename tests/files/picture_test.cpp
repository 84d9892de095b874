#include "client/files/picture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "tests/files/read_png.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

constexpr std::array<std::uint8_t, 3> kLowest{0x44, 0x01, 0x54}, kHighest{0xfd, 0xe7, 0x25},
    kGrey{0x80, 0x80, 0x80};

Panel example() {
  Panel panel;
  panel.title = "true modulus";
  panel.nx = 60, panel.ny = 40;
  panel.unit = "kPa", panel.factor = 1e-3;
  panel.low = 0, panel.high = 100e3;
  panel.values.assign(60 * 40, 10e3f);
  return panel;
}

class PictureFile : public testing::Test {
 protected:
  Pixels drawn(const std::vector<Panel>& panels, const PictureOptions& options = {}) {
    write_png(folder / "a.png", panels, options);
    return read_png(folder / "a.png");
  }
  TemporaryFolder folder;
};

TEST_F(PictureFile, EachValueHasItsPlaceAndColour) {
  Panel panel = example();
  for (std::size_t i = 0; i < panel.values.size(); ++i) {
    const bool left = i % panel.nx < panel.nx / 2, above = i / panel.nx < panel.ny / 2;
    panel.values[i] = left ? (above ? 0 : NAN) : (above ? 100e3f : INFINITY);
  }
  const Pixels p = drawn({panel});
  const Spot low = spot_of(p, kLowest), high = spot_of(p, kHighest), grey = spot_of(p, kGrey);
  EXPECT_GT(low.count, 30'000u);
  EXPECT_NEAR(double(high.count), double(low.count), 0.05 * double(low.count));
  EXPECT_NEAR(double(grey.count), 2 * double(low.count), 0.1 * double(low.count));
  EXPECT_GT(high.x, low.x + 200);
  EXPECT_NEAR(high.y, low.y, 10);
  EXPECT_GT(grey.y, low.y + 100);
}

TEST_F(PictureFile, KeepsTheAspectOfTheTissue) {
  Panel panel = example();
  panel.dx_m = 1e-3, panel.dy_m = .25e-3;  // 60 x 10 mm
  panel.values.assign(panel.values.size(), NAN);
  const std::size_t flat = count_of(drawn({panel}), kGrey);
  panel.dy_m = .5e-3;
  EXPECT_NEAR(double(count_of(drawn({panel}), kGrey)), 2 * double(flat), 0.1 * double(flat));
}

TEST_F(PictureFile, OneLineOfValuesIsDrawn) {
  Panel panel = example();
  panel.nx = 1, panel.ny = 40, panel.dx_m = 0.04;
  panel.values.assign(40, 100e3f);
  EXPECT_GT(count_of(drawn({panel}), kHighest), 50'000u);
}

TEST_F(PictureFile, AnImageIsGreyBesideAMapInColours) {
  Panel image = example(), map = example();
  image.grey = true;
  image.values.assign(image.values.size(), 100e3f), map.values.assign(map.values.size(), 0.0f);
  const Pixels p = drawn({image, map});
  EXPECT_LT(count_of(p, kHighest), 5'000u) << "the bar of the map alone";
  EXPECT_GT(count_of(p, kLowest), 50'000u);
}

TEST_F(PictureFile, PanelsAreInRowsOfWhichTheLastNeedNotBeFull) {
  const std::vector<Panel> panels(4, example());
  const PictureOptions rows_of_three{.columns = 3, .panel_width = 480};
  const Pixels one = drawn({panels.begin(), panels.begin() + 3}, rows_of_three),
               two = drawn(panels, rows_of_three);
  EXPECT_EQ(two.height, 2 * one.height);
  EXPECT_EQ(two.width, one.width);
}

// A name may come from a file, or from a service.
TEST_F(PictureFile, NoTextIsACommand) {
  Panel panel = example();
  for (const std::string& command :
       {"`touch " + (folder / "made").string() + "`", "!touch " + (folder / "made").string(),
        "system('touch " + (folder / "made").string() + "')"}) {
    panel.title = "'\n" + command + "\n'" + command;
    panel.unit = panel.down = panel.title + "\r" + command;
    drawn({panel});
    EXPECT_FALSE(std::filesystem::exists(folder / "made")) << command;
  }
  EXPECT_EQ(gnuplot_string("anna's\n{/tmp}"), "'anna\u2019s {/tmp}'");
}

TEST_F(PictureFile, RefusesUnusablePanels) {
  Panel panel = example();
  panel.values.pop_back();
  EXPECT_THROW(drawn({panel}), std::invalid_argument);
  panel = example();
  panel.dy_m = 0;
  EXPECT_THROW(drawn({panel}), std::invalid_argument);
  panel.dy_m = 1e6;
  EXPECT_THROW(drawn({panel}), std::invalid_argument);
  EXPECT_THROW(write_png(folder / "no" / "a.png", std::vector{example()}), FileError);
}

TEST_F(PictureFile, WithoutGnuplotThereIsNoneAndItIsSaid) {
  const std::string path = std::getenv("PATH");
  setenv("PATH", "/nowhere", 1);
  try {
    drawn({example()});
    ADD_FAILURE();
  } catch (const FileError& error) {
    EXPECT_NE(std::string(error.what()).find("install gnuplot-nox"), std::string::npos) << error.what();
  }
  setenv("PATH", path.c_str(), 1);
  EXPECT_THROW(plot(folder / "a.png", 100, 100, "plot nothing\n"), FileError);
  EXPECT_TRUE(std::filesystem::is_empty(folder / ""));
}

}  // namespace
}  // namespace teletact::client
