#include "client/files/png.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "client/files/font.h"
#include "tests/files/read_png.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

Panel example() {
  Panel panel;
  panel.title = "true modulus";
  panel.nx = 60, panel.ny = 40;
  panel.unit = "kPa", panel.factor = 1e-3;
  panel.low = 0, panel.high = 100e3;
  panel.values.assign(60 * 40, 10e3f);
  return panel;
}

TEST(Png, ColourMapRisesInLightnessSoThatItReadsInGrey) {
  double last = -1;
  for (int i = 0; i <= 100; ++i) {
    const auto c = colour_at(i / 100.0);
    const double lightness =
        .2126 * std::pow(c[0], 2.2) + .7152 * std::pow(c[1], 2.2) + .0722 * std::pow(c[2], 2.2);
    EXPECT_GE(lightness, last) << i;
    last = lightness;
  }
  EXPECT_EQ(colour_at(-1), colour_at(0));
  EXPECT_EQ(colour_at(2), colour_at(1));
}

TEST(Png, ReadsBackAsDrawn) {
  const TemporaryFolder folder;
  const Picture drawn = draw(std::vector{example(), example()});
  write_png(folder / "a.png", drawn);
  const Picture read = read_png(folder / "a.png");
  EXPECT_EQ(read.width, drawn.width);
  EXPECT_EQ(read.height, drawn.height);
  EXPECT_EQ(read.rgb, drawn.rgb);
}

TEST(Png, KeepsTheAspectOfTheTissueAndDrawsNaNGrey) {
  Panel panel = example();
  panel.dx_m = 1e-3, panel.dy_m = .25e-3;  // 60 x 10 mm
  panel.values.assign(panel.values.size(), std::numeric_limits<float>::quiet_NaN());
  const Picture p = draw(std::vector{panel}, {.columns = 0, .panel_width = 300});
  EXPECT_EQ(count_of(p, kNanGrey), 300u * 50u);
}

TEST(Png, EachValueHasItsPlace) {
  Panel panel = example();
  panel.nx = 2, panel.ny = 2;
  panel.values = {0, 1, 2, 3};
  panel.low = 0, panel.high = 3;
  const Picture p = draw(std::vector{panel}, {.columns = 0, .panel_width = 100});
  const auto first =
      [&](std::size_t value) {  // first pixel with that colour in rows of the map's middle columns
        const auto c = colour_at(static_cast<double>(value) / 3);
        for (std::size_t i = 0; i < p.rgb.size() / 3; ++i)
          if (std::equal(c.begin(), c.end(), p.rgb.begin() + static_cast<std::ptrdiff_t>(3 * i)))
            return std::pair(i % p.width, i / p.width);
        return std::pair(p.width, p.height);
      };
  EXPECT_LT(first(0).first, first(1).first);
  EXPECT_EQ(first(0).second, first(1).second);
  EXPECT_LT(first(0).second, first(2).second);
  EXPECT_EQ(first(0).first, first(2).first);
}

TEST(Png, StripsCanBeStackedAndPanelsSitBesideEachOther) {
  const std::vector panels{example(), example(), example()};
  const Picture row = draw(panels), column = draw(panels, {.columns = 1, .panel_width = 480});
  EXPECT_EQ(row.width, 3 * column.width);
  EXPECT_EQ(column.height, 3 * row.height);
}

TEST(Png, LastRowThatIsNotFullIsDrawn) {
  const std::vector panels(4, example());
  const PictureOptions rows_of_three{.columns = 3, .panel_width = 480};
  const Picture one = draw(std::span(panels).first(3), rows_of_three), two = draw(panels, rows_of_three);
  EXPECT_EQ(two.height, 2 * one.height);
  EXPECT_EQ(two.width, one.width);
}

TEST(Png, LettersAndDigitsDiffer) {
  const std::string text = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz.-+()/%:";
  for (std::size_t i = 0; i < text.size(); ++i)
    for (std::size_t k = 0; k < i; ++k) EXPECT_NE(glyph(text[i]), glyph(text[k])) << text[i] << text[k];
  EXPECT_EQ(glyph('\x01'), glyph('?'));
}

TEST(Png, RefusesUnusablePanels) {
  Panel panel = example();
  panel.values.pop_back();
  EXPECT_THROW(draw(std::vector{panel}), std::invalid_argument);
  panel = example();
  panel.dy_m = 0;
  EXPECT_THROW(draw(std::vector{panel}), std::invalid_argument);
  panel.dy_m = 1e6;
  EXPECT_THROW(draw(std::vector{panel}), std::invalid_argument);
  const TemporaryFolder folder;
  EXPECT_THROW(write_png(folder / "no" / "a.png", std::vector{example()}), FileError);
}

}  // namespace
}  // namespace teletact::client
