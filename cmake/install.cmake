# What is installed, in three components, and their Debian packages: service, client, and dev (the contract, the
# C interface of devices with the template, the documents). dev holds sources only: the same from every build.
include(GNUInstallDirs)
set(documents ${CMAKE_INSTALL_DATAROOTDIR}/doc)

set(CPACK_COMPONENTS_ALL dev)
if(TARGET teletact-service)
  list(APPEND CPACK_COMPONENTS_ALL service)
  install(TARGETS teletact-service RUNTIME COMPONENT service)
  install(PROGRAMS packaging/teletact-credentials TYPE BIN COMPONENT service)
  install(FILES packaging/systemd/teletact.service DESTINATION lib/systemd/system COMPONENT service)
  install(DIRECTORY packaging/systemd/teletact@.service.d DESTINATION ${documents}/teletact-service/examples/systemd COMPONENT service)
  install(DIRECTORY packaging/haproxy packaging/prometheus packaging/slurm DESTINATION ${documents}/teletact-service/examples COMPONENT service)
  if(TARGET service_main)
    install(TARGETS service_main LIBRARY DESTINATION lib/teletact COMPONENT service)
    set(CPACK_DEBIAN_SERVICE_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${PROJECT_BINARY_DIR}/service)
  endif()
  if(TELETACT_LEVELS AND TELETACT_LEVEL STREQUAL "x86-64-v2")
    include(ExternalProject)
    ExternalProject_Add(x86-64-v3 SOURCE_DIR ${PROJECT_SOURCE_DIR} BINARY_DIR ${PROJECT_BINARY_DIR}/x86-64-v3
      CMAKE_ARGS -DCMAKE_BUILD_TYPE=${CMAKE_BUILD_TYPE} -DCMAKE_CXX_COMPILER=${CMAKE_CXX_COMPILER}
                 -DTELETACT_NATIVE=OFF -DTELETACT_LEVEL=x86-64-v3 -DTELETACT_CLIENT=OFF -DBUILD_TESTING=OFF
                 -DCMAKE_SHARED_LINKER_FLAGS=-s  # CPack strips targets alone
      BUILD_COMMAND ${CMAKE_COMMAND} --build <BINARY_DIR> --target service_main
      BUILD_ALWAYS ON USES_TERMINAL_BUILD ON INSTALL_COMMAND "")
    install(FILES ${PROJECT_BINARY_DIR}/x86-64-v3/service/libteletact-service.so
      DESTINATION lib/teletact/glibc-hwcaps/x86-64-v3 COMPONENT service)
  endif()
endif()
if(TARGET teletact-client)
  list(APPEND CPACK_COMPONENTS_ALL client)
  install(TARGETS teletact-client RUNTIME COMPONENT client)
  install(TARGETS teletact_force_dimension teletact_openhaptics teletact-device-box
    LIBRARY DESTINATION lib/teletact COMPONENT client RUNTIME DESTINATION lib/teletact COMPONENT client)
endif()
install(FILES client/haptic/teletact_device.h TYPE INCLUDE COMPONENT dev)
install(FILES client/haptic/plugins/template.c DESTINATION ${documents}/teletact-dev/examples COMPONENT dev)
install(DIRECTORY proto/teletact DESTINATION ${CMAKE_INSTALL_DATADIR}/teletact/proto COMPONENT dev FILES_MATCHING PATTERN *.proto)
install(DIRECTORY docs DESTINATION ${documents}/teletact-dev COMPONENT dev PATTERN site EXCLUDE PATTERN CMakeLists.txt EXCLUDE)
install(FILES README.md DESTINATION ${documents}/teletact-dev COMPONENT dev)
foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  install(FILES CHANGELOG.md DESTINATION ${documents}/teletact-${component} COMPONENT ${component})
  install(FILES LICENSE DESTINATION ${documents}/teletact-${component} RENAME copyright COMPONENT ${component})
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_PACKAGE_NAME teletact)
set(CPACK_PACKAGE_CONTACT "teletact maintainers <maintainers@teletact.invalid>")
set(CPACK_PACKAGING_INSTALL_PREFIX ${CMAKE_INSTALL_PREFIX})
set(CPACK_STRIP_FILES ON)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/sbom.cmake)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)  # teletact-client_0.1.0_amd64.deb
set(CPACK_DEBIAN_PACKAGE_SECTION science)

set(CPACK_DEBIAN_SERVICE_PACKAGE_NAME teletact-service)
set(CPACK_COMPONENT_SERVICE_DESCRIPTION "touch of tissue from afar: the solver service
Turns ultrasound RF into stiffness on OpenCL, builds finite-element models,
and answers how they push back on a fingertip, over gRPC.")
set(CPACK_DEBIAN_SERVICE_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_SERVICE_PACKAGE_DEPENDS "pocl-opencl-icd | opencl-icd, openssl")
set(CPACK_DEBIAN_SERVICE_PACKAGE_CONTROL_EXTRA
  ${PROJECT_SOURCE_DIR}/packaging/debian/postinst ${PROJECT_SOURCE_DIR}/packaging/debian/prerm)

set(CPACK_DEBIAN_CLIENT_PACKAGE_NAME teletact-client)
set(CPACK_COMPONENT_CLIENT_DESCRIPTION "touch of tissue from afar: patient side and operator side
Acquires ultrasound RF for a teletact service, and lets a haptic device touch
the tissue that it publishes, at 1 kHz with bounded forces.")
set(CPACK_DEBIAN_CLIENT_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_CLIENT_PACKAGE_DEPENDS "gnuplot-nox")  # all pictures

set(CPACK_DEBIAN_DEV_PACKAGE_NAME teletact-dev)
set(CPACK_COMPONENT_DEV_DESCRIPTION "touch of tissue from afar: contract, device interface, documents
The gRPC contract, the C header of device plugins with a template to start
from, and teletact's documents.")
set(CPACK_DEBIAN_DEV_PACKAGE_ARCHITECTURE all)
include(CPack)
