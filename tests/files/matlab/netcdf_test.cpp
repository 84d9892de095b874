// NetCDF-4 as HDF5 reads it: dimensions, units, values. That NetCDF's own library and xarray read it is
// tests/python/netcdf_test.py.
#include "client/files/netcdf.h"

#include <gtest/gtest.h>
#include <hdf5.h>
#include <hdf5_hl.h>
#include <sys/resource.h>

#include <cmath>
#include <csignal>

#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

NetcdfContent example() {
  return {{{"y", 0.01, 0.002, 2}, {"x", -0.001, 0.0005, 3}},
          {{"youngs_modulus", "Pa", {"y", "x"}, std::vector<float>{1, 2, 3, 4, NAN, 6}},
           {"b_mode", "1", {"y", "x"}, std::vector<std::uint8_t>{0, 50, 100, 150, 200, 255}},
           {"valid", "1", {"y", "x"}, std::vector<NetcdfFlag>{{1}, {1}, {1}, {1}, {0}, {1}}}},
          {{"background_modulus", 2.5},
           {"modulus_absolute", std::int64_t{1}},
           {"modulus_model", std::string("")},
           {"modulus_method", std::string("direct")},
           {"warnings", std::vector<std::string>{"noise: 3 µm", "lone"}},
           {"stages", std::vector<std::string>{}},
           {"stages_s", std::vector<double>{0.5, 1.5}}}};
}

std::string text_of(hid_t object, const char* attribute) {
  const hid_t read = H5Aopen(object, attribute, H5P_DEFAULT), type = H5Aget_type(read);
  std::string out(H5Tget_size(type), '\0');
  EXPECT_GE(H5Aread(read, type, out.data()), 0) << attribute;
  H5Tclose(type), H5Aclose(read);
  return out;
}

template <class T>
std::vector<T> values_of(hid_t data, hid_t type) {
  const hid_t space = H5Dget_space(data);
  std::vector<T> out(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
  EXPECT_GE(H5Dread(data, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, out.data()), 0);
  H5Sclose(space);
  return out;
}

TEST(Netcdf, IsReadBackWithItsAxesAndUnits) {
  const TemporaryFolder folder;
  NetcdfContent content = example();
  content.attributes.emplace_back("long", std::string(100'000, 'x'));  // whatever a service says
  ASSERT_TRUE(write_netcdf(folder / "a.nc", content));
  const hid_t file = H5Fopen((folder / "a.nc").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  ASSERT_GE(file, 0);
  for (const auto& [name, first, step] : {std::tuple{"y", 0.01, 0.002}, std::tuple{"x", -0.001, 0.0005}}) {
    const hid_t axis = H5Dopen2(file, name, H5P_DEFAULT);
    EXPECT_GT(H5DSis_scale(axis), 0);
    EXPECT_EQ(text_of(axis, "units"), "m");
    const auto places = values_of<double>(axis, H5T_NATIVE_DOUBLE);
    for (std::size_t k = 0; k < places.size(); ++k)
      EXPECT_DOUBLE_EQ(places[k], first + step * static_cast<double>(k));
    H5Dclose(axis);
  }
  const hid_t modulus = H5Dopen2(file, "youngs_modulus", H5P_DEFAULT);
  for (const auto& [dimension, name] : {std::pair{0U, "y"}, std::pair{1U, "x"}}) {
    const hid_t axis = H5Dopen2(file, name, H5P_DEFAULT);
    EXPECT_GT(H5DSis_attached(modulus, axis, dimension), 0) << name;
    H5Dclose(axis);
  }
  EXPECT_EQ(text_of(modulus, "units"), "Pa");
  EXPECT_EQ(text_of(modulus, "long_name"), "youngs modulus");
  const auto values = values_of<float>(modulus, H5T_NATIVE_FLOAT);
  ASSERT_EQ(values.size(), 6U);
  EXPECT_EQ(values[3], 4);
  EXPECT_TRUE(std::isnan(values[4]));
  H5Dclose(modulus);
  const hid_t b_mode = H5Dopen2(file, "b_mode", H5P_DEFAULT);
  EXPECT_EQ(values_of<int>(b_mode, H5T_NATIVE_INT), (std::vector<int>{0, 50, 100, 150, 200, 255}));
  H5Dclose(b_mode);
  const hid_t root = H5Gopen2(file, "/", H5P_DEFAULT);
  EXPECT_EQ(text_of(root, "modulus_method"), "direct");
  EXPECT_EQ(text_of(root, "Conventions"), "CF-1.8");
  EXPECT_EQ(text_of(root, "long").size(), 100'000U);
  H5Gclose(root), H5Fclose(file);
}

TEST(Netcdf, WhatDoesNotFitIsNamed) {
  const TemporaryFolder folder;
  const auto said = [&](const NetcdfContent& content) -> std::string {
    try {
      write_netcdf(folder / "a.nc", content);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "no error";
  };
  NetcdfContent content = example();
  content.variables[0].values = std::vector<float>(5);
  EXPECT_NE(said(content).find("'youngs_modulus' does not fit its axes"), std::string::npos);
  content.variables[0].axes = {"y", "z"};
  EXPECT_NE(said(content).find("'z', which is not an axis"), std::string::npos);
}

TEST(Netcdf, WhatCannotBeWrittenWholeIsNotThere) {
  const TemporaryFolder folder;
  EXPECT_THROW(write_netcdf(folder / "absent/a.nc", example()), FileError);
  // As a disk that fills up.
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit little{1000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &little);
  EXPECT_THROW(write_netcdf(folder / "a.nc", example()), FileError);
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_FALSE(std::filesystem::exists(folder / "a.nc"));
  EXPECT_TRUE(write_netcdf(folder / "a.nc", example()));
}

}  // namespace
}  // namespace teletact::client
