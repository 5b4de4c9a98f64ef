//! How QGIS draws the layer: the table `layer_styles` with one symbol for each class, fainter where an object is not
//! reported.
//!
//! Source: the table as QGIS itself makes it when a style is saved to a GeoPackage, and its QML format.

use geopackage::core::types::ColumnType;
use geopackage::{ColumnSpec, GeoPackage, TableSchemaBuilder};
use rusqlite::params;
use std::fmt::Write;

/// Class, shape, red-green-blue, size in millimetres.
const SYMBOLS: [(&str, &str, &str, &str); 5] = [
    ("tree", "circle", "118,42,131", "2.4"),
    ("rock", "pentagon", "110,110,110", "2.8"),
    ("drop", "triangle", "215,48,39", "3.2"),
    ("wall", "square", "140,81,10", "2.6"),
    ("brush", "star", "27,120,55", "2.8"),
];

/// Makes the table with the style of the layer of objects.
pub fn create(gpkg: &GeoPackage, layer: &str) -> geopackage::Result<()> {
    let text = |name: &str, length: Option<u32>| ColumnSpec::new(name, ColumnType::Text(length));
    let table = TableSchemaBuilder::new("layer_styles")
        .primary_key("id")
        .identifier("layer_styles")
        .column(text("f_table_catalog", Some(256)))
        .column(text("f_table_schema", Some(256)))
        .column(text("f_table_name", Some(256)))
        .column(text("f_geometry_column", Some(256)))
        .column(text("styleName", Some(30)))
        .column(text("styleQML", None))
        .column(text("styleSLD", None))
        .column(ColumnSpec::new("useAsDefault", ColumnType::Boolean))
        .column(text("description", None))
        .column(text("owner", Some(30)))
        .column(text("ui", Some(30)))
        .column(ColumnSpec::new("update_time", ColumnType::DateTime));
    gpkg.create_attributes_table(&table)?;
    let sql = "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName, \
               styleQML, styleSLD, useAsDefault, description, owner, update_time) \
               VALUES ('', '', ?1, 'geom', 'objects by class', ?2, '', 1, ?3, '', strftime('%Y-%m-%dT%H:%M:%fZ'))";
    let description = "One symbol for each class; fainter where an object is not reported";
    gpkg.connection().execute(sql, params![layer, qml(), description])?;
    Ok(())
}

/// The style as QGIS writes it: options for today's versions, `prop` for those before 3.26.
fn qml() -> String {
    let (mut categories, mut symbols) = (String::new(), String::new());
    for (i, (class, shape, colour, size)) in SYMBOLS.iter().enumerate() {
        let category = r#"<category render="true" type="string""#;
        let _ = writeln!(categories, r#"   {category} symbol="{i}" value="{class}" label="{class}"/>"#);
        let _ = write!(symbols, "{}", symbol(i, shape, colour, size));
    }
    format!(
        r#"<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22" styleCategories="Symbology|MapTips">
 <renderer-v2 type="categorizedSymbol" attr="class" symbollevels="0" enableorderby="0" forceraster="0">
  <categories>
{categories}  </categories>
  <symbols>
{symbols}  </symbols>
 </renderer-v2>
 <previewExpression>"label"</previewExpression>
 <mapTip>[% "label" %]: confidence [% round("confidence", 1) %], seen [% "sightings" %] times</mapTip>
 <layerGeometryType>0</layerGeometryType>
</qgis>
"#
    )
}

fn symbol(number: usize, shape: &str, colour: &str, size: &str) -> String {
    let colour = format!("{colour},255");
    let values = [
        ("name", shape),
        ("color", &colour),
        ("outline_color", "35,35,35,255"),
        ("outline_width", "0.2"),
        ("size", size),
    ];
    let units = [("outline_width_unit", "MM"), ("size_unit", "MM"), ("outline_style", "solid")];
    let all = || values.iter().chain(&units);
    let options: String = all().map(|(k, v)| format!(r#"<Option type="QString" name="{k}" value="{v}"/>"#)).collect();
    let props: String = all().map(|(k, v)| format!(r#"<prop k="{k}" v="{v}"/>"#)).collect();
    let faint = concat!(
        r#"<data_defined_properties><Option type="Map"><Option type="QString" name="name" value=""/>"#,
        r#"<Option type="Map" name="properties"><Option type="Map" name="alpha"><Option type="bool" name="active" "#,
        r#"value="true"/><Option type="QString" name="expression" value="if(&quot;reported&quot;, 100, 30)"/>"#,
        r#"<Option type="int" name="type" value="3"/></Option></Option>"#,
        r#"<Option type="QString" name="type" value="collection"/></Option></data_defined_properties>"#,
    );
    format!(
        r#"   <symbol type="marker" name="{number}" alpha="1" clip_to_extent="1" force_rhr="0">
    {faint}
    <layer class="SimpleMarker" enabled="1" pass="0" locked="0"><Option type="Map">{options}</Option>{props}</layer>
   </symbol>
"#
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_contract::Class;

    #[test]
    fn every_class_has_its_symbol_and_every_tag_is_closed() {
        let qml = qml();
        for class in Class::ALL.iter().filter(|c| **c != Class::Unknown) {
            assert!(qml.contains(&format!(r#"value="{class}" label="{class}""#)), "{class}");
        }
        for tag in ["qgis", "renderer-v2", "categories", "symbols", "symbol", "layer", "data_defined_properties"] {
            let (opened, closed) = (format!("<{tag}"), format!("</{tag}>"));
            let starts = qml.match_indices(&opened).filter(|(at, _)| qml[at + opened.len()..].starts_with([' ', '>']));
            assert_eq!(starts.count(), qml.matches(&closed).count(), "{tag}");
        }
    }
}
