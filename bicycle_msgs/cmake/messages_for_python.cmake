# The build of messages where ROS 2 comes from PyPI; a native one is left as it is. Include it
# between find_package and rosidl_generate_interfaces.

# The wheels' Python targets name an include folder of the machine that built them, and CMake
# refuses a folder that does not exist.
foreach(dependency IN ITEMS action_msgs builtin_interfaces geometry_msgs nav_msgs service_msgs std_msgs
    unique_identifier_msgs)
  set(target ${dependency}::${dependency}__rosidl_generator_py)
  if(TARGET ${target})
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    foreach(folder IN LISTS folders)
      if(IS_ABSOLUTE "${folder}" AND NOT EXISTS "${folder}")
        set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "")
      endif()
    endforeach()
  endif()
endforeach()

# The found packages bring the generators for C++ along, so that they can only be left out here.
option(PYTHON_ONLY "Generate what rclpy needs over Fast DDS, and nothing for C++" OFF)
if(PYTHON_ONLY)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "cpp")
endif()
