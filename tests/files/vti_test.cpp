#include "client/files/vti.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <sstream>

#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

// Just enough XML to read a .vti: elements with attributes and text; fails the test when not well-formed.
struct Element {
  std::string name, text;
  std::map<std::string, std::string> attributes;
  std::vector<Element> children;
  const Element& child(const std::string& wanted) const {
    for (const Element& c : children)
      if (c.name == wanted) return c;
    throw std::runtime_error("no element " + wanted);
  }
};

class Parser {
 public:
  explicit Parser(std::string xml) : xml_(std::move(xml)) {}
  Element document() {
    expect("<?xml");
    at_ = xml_.find("?>", at_) + 2;
    space();
    Element root = element();
    space();
    if (at_ != xml_.size()) fail("text after the root element");
    return root;
  }

 private:
  Element element() {
    expect("<");
    Element e;
    e.name = word();
    for (space(); peek() != '>'; space()) {
      const std::string key = word();
      expect("=\"");
      const auto end = xml_.find('"', at_);
      if (!e.attributes.emplace(key, unescaped(xml_.substr(at_, end - at_))).second)
        fail("attribute given twice");
      at_ = end + 1;
    }
    expect(">");
    for (;;) {
      const auto next = xml_.find('<', at_);
      if (next == std::string::npos) fail("element not closed");
      e.text += unescaped(xml_.substr(at_, next - at_));
      at_ = next;
      if (xml_.compare(at_, 2, "</") == 0) break;
      e.children.push_back(element());
    }
    expect("</" + e.name + ">");
    return e;
  }
  std::string unescaped(std::string text) {
    for (std::size_t i = 0; i < text.size(); ++i) {
      const auto c = static_cast<unsigned char>(text[i]);
      if (c == '<' || (c < 32 && c != '\n' && c != '\t')) fail("character not allowed");
      if (c != '&') continue;
      const auto end = text.find(';', i);
      const std::map<std::string, std::string> known{
          {"&amp;", "&"}, {"&lt;", "<"}, {"&gt;", ">"}, {"&quot;", "\""}};
      text.replace(i, end - i + 1, known.at(text.substr(i, end - i + 1)));
    }
    return text;
  }
  std::string word() {
    const auto begin = at_;
    while (std::isalnum(static_cast<unsigned char>(peek())) || peek() == '_') ++at_;
    if (at_ == begin) fail("name expected");
    return xml_.substr(begin, at_ - begin);
  }
  char peek() const { return xml_.at(at_); }
  void space() {
    while (at_ < xml_.size() && std::isspace(static_cast<unsigned char>(xml_[at_]))) ++at_;
  }
  void expect(const std::string& text) {
    if (xml_.compare(at_, text.size(), text) != 0) fail("expected " + text);
    at_ += text.size();
  }
  [[noreturn]] void fail(const std::string& what) const {
    throw std::runtime_error(what + " at " + std::to_string(at_));
  }
  std::string xml_;
  std::size_t at_ = 0;
};

std::vector<unsigned char> decoded(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::vector<unsigned char> out;
  unsigned bits = 0;
  int count = 0;
  for (const char c : text) {
    const auto digit = digits.find(c);
    if (digit == std::string::npos) continue;
    bits = bits << 6 | static_cast<unsigned>(digit);
    if ((count += 6) >= 8) out.push_back(static_cast<unsigned char>(bits >> (count -= 8) & 255));
  }
  return out;
}

template <class T>
std::vector<T> values_of(const Element& array) {
  const auto bytes = decoded(array.text);
  std::uint64_t size = 0;
  std::memcpy(&size, bytes.data(), sizeof size);
  EXPECT_EQ(size, bytes.size() - 8);
  std::vector<T> out(size / sizeof(T));
  std::memcpy(out.data(), bytes.data() + 8, size);
  return out;
}

TEST(Vti, ParsesBackToWhatWasWritten) {
  const TemporaryFolder folder;
  const VtiGrid grid{{5, 3, 1}, {.06, 1e-4, 0}, {2.34375e-4, 1.925e-5, 1}};
  std::vector<float> modulus(15), u(30);
  for (std::size_t i = 0; i < 15; ++i) modulus[i] = 1e4f / static_cast<float>(i + 1);
  for (std::size_t i = 0; i < 30; ++i) u[i] = -1e-6f * static_cast<float>(i);
  modulus[7] = std::numeric_limits<float>::quiet_NaN();
  const std::vector<std::uint8_t> valid{1, 0, 1, 1, 255, 0, 0, 0, 1, 1, 1, 0, 1, 0, 2};
  write_vti(folder / "maps.vti", grid,
            {{"youngs_modulus", modulus, 1}, {"u <m> & \"more\"", u, 2}, {"valid", valid, 1}});
  const Element root = Parser(content_of(folder / "maps.vti")).document();
  EXPECT_EQ(root.name, "VTKFile");
  EXPECT_EQ(root.attributes.at("type"), "ImageData");
  EXPECT_EQ(root.attributes.at("byte_order"), "LittleEndian");
  EXPECT_EQ(root.attributes.at("header_type"), "UInt64");
  const Element& image = root.child("ImageData");
  EXPECT_EQ(image.attributes.at("WholeExtent"), "0 4 0 2 0 0");
  std::istringstream spacing(image.attributes.at("Spacing"));
  double dx = 0, dy = 0;
  spacing >> dx >> dy;
  EXPECT_EQ(dx, 2.34375e-4);
  EXPECT_EQ(dy, 1.925e-5);
  const auto& arrays = image.child("Piece").child("PointData").children;
  ASSERT_EQ(arrays.size(), 3u);
  EXPECT_EQ(arrays[1].attributes.at("Name"), "u <m> & \"more\"");
  EXPECT_EQ(arrays[1].attributes.at("NumberOfComponents"), "2");
  EXPECT_EQ(arrays[2].attributes.at("type"), "UInt8");
  const auto read = values_of<float>(arrays[0]);
  ASSERT_EQ(read.size(), modulus.size());
  EXPECT_EQ(std::memcmp(read.data(), modulus.data(), 15 * sizeof(float)), 0) << "bit for bit, NaN too";
  EXPECT_EQ(values_of<float>(arrays[1]), u);
  EXPECT_EQ(values_of<std::uint8_t>(arrays[2]), valid);
}

TEST(Vti, RefusesArraysThatDoNotFit) {
  const TemporaryFolder folder;
  EXPECT_THROW(
      write_vti(folder / "a.vti", VtiGrid{{5, 3, 1}, {}, {1, 1, 1}}, {{"a", std::vector<float>(14), 1}}),
      std::invalid_argument);
  EXPECT_THROW(write_vti(folder / "no" / "a.vti", VtiGrid{{1, 1, 1}, {}, {1, 1, 1}},
                         {{"a", std::vector<float>(1), 1}}),
               FileError);
}

}  // namespace
}  // namespace teletact::client
