# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
crtk_msgs for tests: the installed package, or two messages of its fields with type support.

crtk_msgs is in no package registry. The generators of ROS come with rclpy's wheels: they and a C
compiler make the messages that `fkm` uses, so that they pass between processes as the real ones.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
import json
from pathlib import Path
import shutil
import subprocess
import sys
import sysconfig

import numpy as np

PACKAGE = 'crtk_msgs'
# The messages that `fkm` uses, and their fields: type and name.
MESSAGES = {
    'OperatingState': (('std_msgs/Header', 'header'), ('string', 'state'), ('boolean', 'is_homed'),
                       ('boolean', 'is_busy')),
    'StringStamped': (('std_msgs/Header', 'header'), ('string', 'string'))}
# Implementations of the type support, and the libraries that they and their messages link to.
SUPPORTS = ('fastrtps_c', 'introspection_c')
LIBRARIES = (
    'rcutils', 'rosidl_runtime_c', 'rosidl_typesupport_c', 'rosidl_typesupport_fastrtps_c',
    'rosidl_typesupport_fastrtps_cpp', 'rosidl_typesupport_introspection_c', 'fastcdr',
    'std_msgs__rosidl_generator_c', 'std_msgs__rosidl_generator_py',
    'std_msgs__rosidl_typesupport_c', 'std_msgs__rosidl_typesupport_fastrtps_c',
    'std_msgs__rosidl_typesupport_introspection_c',
    'builtin_interfaces__rosidl_generator_c', 'stdc++')
PREFIX = Path(sys.prefix)
# It loads the type supports by their names, because they are on no library path.
LOADER = '\n'.join((
    'import ctypes', 'from pathlib import Path',
    "for each in Path(__file__).parent.glob('lib*.so'):", '    ctypes.CDLL(str(each))', ''))


def is_installed() -> bool:
    """Return whether the real package is there."""
    return find_spec(PACKAGE) is not None


def can_be_built() -> bool:
    """Return whether compiler, headers and generators are there."""
    return shutil.which('gcc') is not None and find_spec('rosidl_adapter') is not None \
        and (PREFIX / 'include' / 'std_msgs').is_dir() \
        and (Path(sysconfig.get_path('include')) / 'Python.h').is_file()


def hide(folder: Path) -> Path:
    """Write a package that cannot be imported; return the folder for PYTHONPATH."""
    (folder / PACKAGE).mkdir()
    (folder / PACKAGE / '__init__.py').write_text("raise ImportError('hidden by the test')\n")
    return folder


def build(folder: Path) -> Path:
    """Build the messages below a folder; return the folder for PYTHONPATH."""
    package, sources = folder / PACKAGE, folder / 'include'
    headers = sources / PACKAGE
    _generate(folder, package, headers)
    (package / '__init__.py').write_text(LOADER)
    code = [str(path) for root in (headers, package) for path in root.rglob('*.c*')
            if '.ep.' not in path.name or path.name.endswith('.rosidl_typesupport_c.c')]
    include = [f'-I{path}' for path in (
        sources, PREFIX / 'include', *(PREFIX / 'include').iterdir(),
        sysconfig.get_path('include'), np.get_include())]
    link = [f'-L{PREFIX / "lib"}', f'-Wl,-rpath,{PREFIX / "lib"}',
            *(f'-l{name}' for name in LIBRARIES)]
    extension = f'{PACKAGE}_s__rosidl_typesupport_c.so'
    _compile(package, *include, *code, '-o', extension, *link)
    (package / 'none.c').write_text('')
    for support in SUPPORTS:
        # A second name of the same library, as the dispatch of the type supports loads it.
        name = f'lib{PACKAGE}__rosidl_typesupport_{support}.so'
        _compile(package, 'none.c', '-Wl,--no-as-needed', '-L.', f'-l:{extension}',
                 f'-Wl,-soname,{name}', '-Wl,-rpath,$ORIGIN', '-o', name)
    return folder


def _generate(folder: Path, package: Path, headers: Path) -> None:
    (headers / 'msg').mkdir(parents=True)
    (folder / 'msg').mkdir()
    for name, fields in MESSAGES.items():
        # rosidl's own language for interfaces calls a bool so.
        lines = ''.join(f'{kind.replace("boolean", "bool")} {field}\n' for kind, field in fields)
        (folder / 'msg' / f'{name}.msg').write_text(lines)
        import_module('rosidl_adapter.msg').convert_msg_to_idl(
            folder, PACKAGE, Path('msg') / f'{name}.msg', folder / 'msg')
    share = PREFIX / 'share'

    def generate(module: str, function: str, target: Path, *more: object) -> None:
        arguments = folder / 'arguments.json'
        arguments.write_text(json.dumps({
            'package_name': PACKAGE, 'output_dir': str(target),
            'template_dir': str(share / module / 'resource'),
            'idl_tuples': [f'{folder}:msg/{name}.idl' for name in MESSAGES],
            'type_description_tuples': [
                f'msg/{name}.idl:{folder}/msg/{name}.json' for name in MESSAGES],
            'include_paths': [f'{name}:{share / name}'
                              for name in ('std_msgs', 'builtin_interfaces')],
            'target_dependencies': [], 'ros_interface_dependencies': [],
            'ros_interface_files': []}))
        getattr(import_module(module), function)(str(arguments), *more)

    names = [f'rosidl_typesupport_{support}' for support in SUPPORTS]
    generate('rosidl_generator_type_description', 'generate_type_hash', folder)
    generate('rosidl_generator_c', 'generate_c', headers)
    generate('rosidl_typesupport_fastrtps_c', 'generate_typesupport_fastrtps_c', headers)
    generate('rosidl_typesupport_introspection_c', 'generate_c', headers)
    generate('rosidl_typesupport_c', 'generate_c', headers, names)
    generate('rosidl_generator_py', 'generate_py', package, ['rosidl_typesupport_c', *names])
    for name in ('rosidl_generator_c', *names):
        (headers / 'msg' / f'{name}__visibility_control.h').write_text(''.join(
            f'#define {name.upper()}_{word}_{PACKAGE}\n' for word in (
                'PUBLIC', 'IMPORT', 'EXPORT')))


def _compile(folder: Path, *arguments: str) -> None:
    subprocess.run(['gcc', '-w', '-shared', '-fPIC', *arguments], cwd=folder, check=True)
