<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="AllStyleCategories">
 <renderer-v2 symbollevels="0" enableorderby="0" forceraster="0" type="singleSymbol">
  <symbols>
   <symbol type="fill" name="0" alpha="1">
    <layer class="SimpleLine" enabled="1" pass="0" locked="0">
     <Option type="Map">
      <Option type="QString" name="line_color" value="$colour"/>
      <Option type="QString" name="line_width" value="$width"/>
      <Option type="QString" name="line_width_unit" value="MM"/>
      <Option type="QString" name="line_style" value="$style"/>
      <Option type="QString" name="joinstyle" value="round"/>
      <Option type="QString" name="capstyle" value="round"/>
     </Option>
     <prop k="line_color" v="$colour"/>
     <prop k="line_width" v="$width"/>
     <prop k="line_width_unit" v="MM"/>
     <prop k="line_style" v="$style"/>
     <prop k="joinstyle" v="round"/>
     <prop k="capstyle" v="round"/>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <blendMode>0</blendMode>
 <layerGeometryType>2</layerGeometryType>
</qgis>
